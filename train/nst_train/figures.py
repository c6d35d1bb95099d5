"""Charts and tables of docs/paper.md, from the metrics in docs/paper/*.csv.

    python -m nst_train.figures                 # rewrite what docs/paper/*.csv gives
    python -m nst_train.figures --check         # compare instead; exit code 1 on a difference
    python -m nst_train.figures --runs runs     # first copy runs/NAME/metrics.csv to docs/paper/NAME.csv,
                                                # and how long each trained to docs/paper/training.csv

A figure is drawn once the networks that it needs have their CSV.
"""

import argparse
import csv
import json
import re
import shutil
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from nst_train.charts import Curve, Panel, Style, draw
from nst_train.errors import UserError
from nst_train.evaluation import COLUMNS, HISTORY_COLUMNS, write_csv
from nst_train.renders import REPOSITORY

PAPER = REPOSITORY / "docs" / "paper"
PAGE = REPOSITORY / "docs" / "paper.md"
DENOISED = "denoised"  # docs/paper/denoised.csv, by docs/denoise.py
DENOISED_COLUMNS = ["name", "method", "n", "mse", "mse_ratio"]
TRAINING = "training.csv"
TRAINING_COLUMNS = ["name", "setting", "device", "threads", "epochs", "seconds"]

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


class Metrics:
    """The CSV files of a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.read: dict[str, list[dict[str, str]]] = {}

    def rows(self, name: str, columns: list[str] = COLUMNS) -> list[dict[str, str]]:
        """All rows of NAME.csv."""
        if name not in self.read:
            self.read[name] = read_csv(self.folder / f"{name}.csv", columns)
        return self.read[name]

    def points(self, name: str, data: str, method: str) -> dict[int, dict[str, str]]:
        """Rows by n."""
        rows = self.rows(name)
        found = [row for row in rows if row["data"] == data and row["method"] == method]
        if not found:
            path = self.folder / f"{name}.csv"
            raise UserError(f"{path}: no rows of method '{method}' on '{data}'; evaluate it again")
        return {int(row["n"]): row for row in found}

    def curve(self, label: str, style: Style, name: str, data: str, method: str) -> Curve:
        """MSE against n."""
        points = self.points(name, data, method)
        return Curve(label, style, list(points), [float(row["mse"]) for row in points.values()])

    def ratio(self, name: str, data: str, method: str, n: int) -> str:
        """A cell of a table; a dash where there is no such n."""
        row = self.points(name, data, method).get(n)
        return digits(float(row["mse_ratio"])) if row else "–"


def read_csv(path: Path, columns: list[str]) -> list[dict[str, str]]:
    """Checks the header."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            if reader.fieldnames != columns:
                raise UserError(f"{path}: expected the columns {','.join(columns)}")
            return list(reader)
    except OSError as error:
        raise UserError(f"{path}: cannot read the metrics: {error.strerror}") from error


def digits(x: float) -> str:
    """Three digits."""
    return f"{x:.3f}" if 0.1 <= x < 1 else f"{x:.3g}" if x < 1000 else f"{x:.0f}"


def scene_of(name: str) -> str:
    """What the held-out set of a rendered experiment is called: its scene."""
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
        for method, (label, _) in OTHERS.items():
            label = label.replace("$a_n g_n$", "a_n g_n")
            rows.append((f"{family}: {label}", family, family, method))
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
        for method in ("constant", "aitken", "levin-u", "an-gn"):
            label = OTHERS[method][0].replace("$a_n g_n$", "a_n g_n")
            rows.append((f"{name}: {label}, random", name, scene_of(name), method))
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
    """A chart and the table beside it, made from the CSV files of some networks."""

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

EXPERIMENTS = tuple(
    dict.fromkeys(name for figure in FIGURES.values() for name in figure.needs if name != DENOISED)
)


def collect(runs: Path, paper: Path) -> list[str]:
    """Copies the metrics of finished runs, and returns their names."""
    names = [name for name in EXPERIMENTS if (runs / name / "metrics.csv").is_file()]
    if not names:
        raise UserError(f"{runs}: no finished run of an experiment in it, such as gaussian/metrics.csv")
    paper.mkdir(parents=True, exist_ok=True)
    for name in names:
        read_csv(runs / name / "metrics.csv", COLUMNS)
        shutil.copyfile(runs / name / "metrics.csv", paper / f"{name}.csv")
    write_csv(paper / TRAINING, TRAINING_COLUMNS, [training_row(runs / name) for name in names])
    return names


def training_row(run: Path) -> list[object]:
    """How long a run trained, in what setting, and on what."""
    last = read_csv(run / "history.csv", HISTORY_COLUMNS)[-1]
    try:
        versions = json.loads((run / "versions.json").read_text(encoding="utf-8"))
        described = [versions[key] for key in ("setting", "device", "threads")]
    except (OSError, ValueError, KeyError) as error:
        raise UserError(f"{run / 'versions.json'}: cannot read it; train again: {error}") from error
    return [run.name, *described, last["epoch"], round(float(last["seconds"]))]


def replace_block(text: str, name: str, content: str, path: Path) -> str:
    """`text` with other lines between `<!-- NAME -->` and `<!-- end of NAME -->`."""
    begin, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->"
    pattern = re.compile(re.escape(begin) + ".*?" + re.escape(end), re.DOTALL)
    replaced, count = pattern.subn(lambda _: f"{begin}{content}\n{end}", text)
    if count != 1:
        raise UserError(f"{path}: expected one pair of markers {begin.strip()} … {end}")
    return replaced


def make(paper: Path, page: str, svgs: Path) -> tuple[str, list[str], list[str]]:
    """Draws into `svgs`, and returns the page with its tables, the figures drawn, and those that lack
    a CSV."""
    metrics = Metrics(paper)
    drawn, lacking = [], []
    for name, figure in FIGURES.items():
        if missing := [need for need in figure.needs if not (paper / f"{need}.csv").is_file()]:
            lacking.append(f"{name}: not drawn, lacks {', '.join(missing)}")
            page = replace_block(page, name, "Not measured yet.", PAGE)
            continue
        draw(figure.panels(metrics), svgs / f"{name}.svg")
        table = figure.table(metrics)
        page = replace_block(page, name, f"![{name}](paper/{name}.svg)\n\n{table}", PAGE)
        drawn.append(name)
    return page, drawn, lacking


def check(paper: Path, page_path: Path) -> None:
    """Raises an error where an SVG or a table is not what the CSV files give."""
    page = page_path.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        made, drawn, _ = make(paper, page, Path(folder))
        stored = sorted(path.stem for path in paper.glob("*.svg"))
        if stored != sorted(drawn):
            raise UserError(f"{paper}: holds {stored}, but its CSV files give {sorted(drawn)}")
        for name in drawn:
            path = paper / f"{name}.svg"
            if path.read_bytes() != (Path(folder) / path.name).read_bytes():
                raise UserError(f"{path}: not what the CSV files give; run nst_train.figures")
    if made != page:
        raise UserError(f"{page_path}: a table is not what the CSV files give; run nst_train.figures")


def main(argv: list[str] | None = None) -> int:
    """`argv` is for tests; without it, the command line. Returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m nst_train.figures", description=__doc__)
    parser.add_argument("--runs", type=Path, metavar="FOLDER", help="copy metrics from here first")
    parser.add_argument("--check", action="store_true", help="compare instead of writing")
    parser.add_argument("--paper", type=Path, default=PAPER, help="[default: docs/paper]")
    parser.add_argument("--page", type=Path, default=PAGE, help="[default: docs/paper.md]")
    a = parser.parse_args(argv)
    try:
        if a.check:
            check(a.paper, a.page)
            return 0
        if a.runs:
            print(f"copied the metrics of {', '.join(collect(a.runs, a.paper))}")
        a.paper.mkdir(parents=True, exist_ok=True)
        page, drawn, lacking = make(a.paper, a.page.read_text(encoding="utf-8"), a.paper)
        a.page.write_text(page, encoding="utf-8")
        print("\n".join([f"drew {', '.join(drawn) or 'nothing'}", *lacking]))
    except (UserError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
