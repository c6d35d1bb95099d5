"""The figures of docs/paper.md: the networks that each needs, its chart, and its table."""

from collections.abc import Callable
from dataclasses import dataclass

from nst_train.charts import Curve, Panel, Style
from nst_train.metrics import Metrics, digits

DENOISED = "denoised"  # docs/paper/denoised.csv, by docs/denoise.py
DENOISED_COLUMNS = ["name", "method", "n", "mse", "mse_ratio"]

FAMILIES = ("gaussian", "step", "gaussian-step")
LOSSES = {"L0": "families-l0", "L1": "families-l1", "L2": "families", "L3": "families-l3"}
WINDOWS = {2: "gaussian-window-2", 4: "gaussian-window-4", 8: "gaussian", 16: "gaussian-window-16"}
PLANES = ("plane-lambert", "plane-ggx")
SCENES = ("teapot-diffuse", "teapot-glossy", "cornell-direct", "cornell-depth-8")
HALTON = "-halton"

S, T = Style("#000000"), Style("#0072b2", width=2.2)
T_ALL = Style("#56b4e9", "--", 2.2)
S_HALTON, T_HALTON = Style("#000000", ":"), Style("#d55e00", width=2.2)
OTHERS = {
    "constant": ("constant", Style("#009e73", "-.")),
    "bayes": ("Bayes limit", Style("#cc79a7", "-.")),
    "aitken": ("Aitken", Style("#999999")),
    "levin-u": ("Levin u", Style("#999999", "--")),
    "an-gn": ("$a_n g_n$", Style("#999999", ":")),
}
FOUR = [Style("#e69f00"), Style("#56b4e9"), Style("#0072b2", width=2.2), Style("#cc79a7")]


def scene_of(name: str) -> str:
    """The name of the held-out set of a rendered experiment: its scene."""
    return "cornell" if name.startswith("cornell") else name.removesuffix(HALTON)


def others(metrics: Metrics, name: str, data: str, methods: tuple[str, ...]) -> list[Curve]:
    return [metrics.curve(*OTHERS[method], name, data, method) for method in methods]


def figure_3(metrics: Metrics) -> list[Panel]:
    def panel(family: str) -> Panel:
        curves = [
            metrics.curve("$S_n$", S, family, family, "S"),
            metrics.curve("$T_n$, trained on the family", T, family, family, "T"),
            metrics.curve("$T'_n$, trained on all three", T_ALL, "families", family, "T"),
        ]
        return Panel(family, curves + others(metrics, family, family, tuple(OTHERS)))

    return [panel(family) for family in FAMILIES]


def figure_4(metrics: Metrics) -> list[Panel]:
    curves = [metrics.curve("$S_n$", S, "families", "gaussian", "S")]
    for style, (loss, name) in zip(FOUR, LOSSES.items(), strict=True):
        curves.append(metrics.curve(loss, style, name, "gaussian", "T"))
    return [Panel("gaussian", curves)]


def figure_windows(metrics: Metrics) -> list[Panel]:
    curves = [metrics.curve("$S_n$", S, WINDOWS[2], "gaussian", "S")]
    for style, (window, name) in zip(FOUR, WINDOWS.items(), strict=True):
        curves.append(metrics.curve(f"M = {window}", style, name, "gaussian", "T"))
    return [Panel("gaussian", curves)]


def rendered_panel(metrics: Metrics, name: str) -> Panel:
    data, halton = scene_of(name), name + HALTON
    curves = [
        metrics.curve("$S_n$, random", S, name, data, "S"),
        metrics.curve("$T_n$, random", T, name, data, "T"),
        metrics.curve("$S_n$, Halton", S_HALTON, halton, data, "S"),
        metrics.curve("$T_n$, Halton", T_HALTON, halton, data, "T"),
    ]
    methods = ("constant", "aitken", "levin-u", "an-gn")
    return Panel(name, curves + others(metrics, name, data, methods))


def figure_7(metrics: Metrics) -> list[Panel]:
    rows = metrics.rows(DENOISED, DENOISED_COLUMNS)
    curves = []
    for method, style in (
        ("S", S),
        ("T", T),
        ("OIDN(S)", Style("#999999")),
        ("OIDN(T)", Style("#d55e00", width=2.2)),
    ):
        mine = [row for row in rows if row["method"] == method]
        n, mse = [int(row["n"]) for row in mine], [float(row["mse"]) for row in mine]
        curves.append(Curve(method, style, n, mse))
    return [Panel("cornell-depth-8", curves)]


def in_text(method: str) -> str:
    """The label of one of `OTHERS` in a table, without TeX."""
    return OTHERS[method][0].replace("$a_n g_n$", "a_n g_n")


def ratio_table(
    metrics: Metrics, first: str, rows: list[tuple[str, str, str, str]], ns: tuple[int, ...]
) -> str:
    """MSE ratios; `rows` are label, network, held-out set, method."""
    lines = [
        f"| {first} | " + " | ".join(f"n = {n}" for n in ns) + " |",
        "|---" * (1 + len(ns)) + "|",
    ]
    for label, name, data, method in rows:
        cells = (metrics.ratio(name, data, method, n) for n in ns)
        lines.append(f"| {label} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def table_3(metrics: Metrics) -> str:
    rows = []
    for family in FAMILIES:
        rows.append((f"{family}: T, trained on it", family, family, "T"))
        rows.append((f"{family}: T′, trained on all three", "families", family, "T"))
        rows += [(f"{family}: {in_text(method)}", family, family, method) for method in OTHERS]
    return ratio_table(metrics, "MSE ratio to S", rows, (8, 16, 32, 64))


def table_4(metrics: Metrics) -> str:
    rows = [(loss, name, "gaussian", "T") for loss, name in LOSSES.items()]
    return ratio_table(metrics, "loss, on gaussian", rows, (8, 16, 32, 64))


def table_windows(metrics: Metrics) -> str:
    rows = [(f"M = {m}", name, "gaussian", "T") for m, name in WINDOWS.items()]
    return ratio_table(metrics, "window, on gaussian", rows, (8, 16, 32, 64))


def table_rendered(metrics: Metrics, names: tuple[str, ...]) -> str:
    rows = []
    for name in names:
        rows.append((f"{name}: T, random", name, scene_of(name), "T"))
        rows.append((f"{name}: T, Halton", name + HALTON, scene_of(name), "T"))
        rows += [
            (f"{name}: {in_text(method)}, random", name, scene_of(name), method)
            for method in ("constant", "aitken", "levin-u", "an-gn")
        ]
    return ratio_table(metrics, "MSE ratio to S of the same sampler", rows, (8, 16, 32))


def table_7(metrics: Metrics) -> str:
    rows = metrics.rows(DENOISED, DENOISED_COLUMNS)
    ns = list(dict.fromkeys(row["n"] for row in rows))
    lines = ["| MSE ratio to S | " + " | ".join(f"n = {n}" for n in ns) + " |"]
    lines.append("|---" * (1 + len(ns)) + "|")
    for method in dict.fromkeys(row["method"] for row in rows):
        mine = {row["n"]: digits(float(row["mse_ratio"])) for row in rows if row["method"] == method}
        lines.append(f"| {method} | " + " | ".join(mine[n] for n in ns) + " |")
    return "\n".join(lines)


@dataclass(frozen=True)
class Figure:
    """A chart and a table, made from the CSV files of some networks."""

    needs: tuple[str, ...]
    panels: Callable[[Metrics], list[Panel]]
    table: Callable[[Metrics], str]


def with_halton(names: tuple[str, ...]) -> tuple[str, ...]:
    return names + tuple(name + HALTON for name in names)


def rendered_figure(names: tuple[str, ...]) -> Figure:
    return Figure(
        with_halton(names),
        lambda metrics: [rendered_panel(metrics, name) for name in names],
        lambda metrics: table_rendered(metrics, names),
    )


FIGURES: dict[str, Figure] = {
    "figure-3": Figure((*FAMILIES, "families"), figure_3, table_3),
    "figure-4": Figure(tuple(LOSSES.values()), figure_4, table_4),
    "windows": Figure(tuple(WINDOWS.values()), figure_windows, table_windows),
    "figure-5": rendered_figure(PLANES),
    "figure-6": rendered_figure(SCENES),
    "figure-7": Figure((DENOISED,), figure_7, table_7),
}
"""By the name of the SVG and of the marker in docs/paper.md."""

SAMPLES = tuple(f"{name}-samples" for name in (*FAMILIES, "families"))
"""Networks that see the samples, which no figure of the paper shows."""

EXPERIMENTS = tuple(
    dict.fromkeys(name for figure in FIGURES.values() for name in figure.needs if name != DENOISED)
)
EXPERIMENTS += SAMPLES
