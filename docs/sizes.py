"""Draws error against the size of the network, and writes the tables of docs/sizes.md, both from the
table that `python -m nst_train.sizes` measures.

    "$(tools/python-env)" docs/sizes.py docs/sizes.csv docs/sizes.svg docs/sizes.md            # writes
    "$(tools/python-env)" docs/sizes.py docs/sizes.csv docs/sizes.svg docs/sizes.md --check    # compares

The same table gives the same bytes. With --check, exit code 1 if the chart or the page is another one.
"""

import argparse
import csv
import io
import re
import sys
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("svg")
# The same file from the same table: no random identifiers, no date; text stays text.
matplotlib.rcParams.update({"svg.hashsalt": "nst", "svg.fonttype": "none", "font.size": 9})

import matplotlib.pyplot as plt  # noqa: E402

NOISE = 2.0
"""Standard errors of a difference that count as noise: 95 % of a normal distribution."""

DARK = {
    "#ffffff": "#0d1117",
    "#000000": "#e6edf3",
    "#dddddd": "#30363d",
    "#005a8e": "#79c0ff",
    "#d55e00": "#ff9d5c",
}
"""What each colour of the chart becomes where the reader prefers dark pages. The two curves differ in
lightness, marker and line, too, so that they can be told apart in grey."""

STYLES = [("#005a8e", "-", "o", "#005a8e"), ("#d55e00", "--", "s", "#ffffff")]
"""Colour, line, marker and its inside: of the longest training, and of a shorter one."""

BLOCKS = ("scores", "verdicts", "sizes")
"""The page's markers, in its order."""


@dataclass(frozen=True)
class Network:
    """One trained network and its scores."""

    scene: str
    network: str  # widths of all layers, "8-16-16-1"
    parameters: int
    multiply_adds: int  # for one lane
    built_in: bool
    seed: int
    epochs: int
    cpu_seconds: float | None  # of training; not known of built-in networks
    runs: np.ndarray  # MSE ratio, mean over n, as each run gives it

    @property
    def mean(self) -> float:
        """E[(T − I)²]/E[(S − I)²], mean over n."""
        return float(self.runs.mean())

    @property
    def hidden(self) -> str:
        """ "2×16" of "8-16-16-1"."""
        widths = self.network.split("-")[1:-1]
        return f"{len(widths)}×{widths[0]}" if len(set(widths)) == 1 else "-".join(widths)


@dataclass(frozen=True)
class Ladder:
    """Sizes that were trained for one scene with the same epochs and the seed of the config, smallest
    first, and what they say."""

    networks: list[Network]
    others: list[Network]  # from other seeds
    spread: float  # standard deviation of `mean` over seeds, in this scene; 0 where not measured

    @property
    def best(self) -> Network:
        return min(self.networks, key=lambda network: network.mean)

    def behind(self, network: Network) -> tuple[float, float]:
        """How much worse than the best, and how much of that may be noise.

        All networks see the same runs: the noise is that of the differences run by run, and of two
        trainings from random weights.
        """
        if network is self.best:
            return 0.0, 0.0
        differences = network.runs - self.best.runs
        variance = differences.var(ddof=1) / len(differences) + 2.0 * self.spread**2
        return float(differences.mean()), NOISE * float(np.sqrt(variance))

    @property
    def enough(self) -> Network:
        """The smallest within noise of the best."""
        return next(n for n in self.networks if np.subtract(*self.behind(n)) <= 0.0)

    @property
    def built_in(self) -> Network | None:
        return next((network for network in self.networks if network.built_in), None)


def read(table: Path) -> list[Network]:
    """The networks of the table, in its order."""
    rows: dict[tuple[str, ...], list[dict[str, str]]] = {}
    with table.open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            key = (row["scene"], row["network"], row["seed"], row["epochs"])
            rows.setdefault(key, []).append(row)
    if not rows:
        sys.exit(f"{table}: has no rows; run nst_train.sizes")
    counts = {tuple(row["n"] for row in found) for found in rows.values()}
    if len(counts) != 1:
        sys.exit(f"{table}: not all networks have the same n, each once: {sorted(counts)}")
    return [network(found) for found in rows.values()]


def network(rows: list[dict[str, str]]) -> Network:
    """Of its rows, one for each n."""
    first = rows[0]
    return Network(
        scene=first["scene"],
        network=first["network"],
        parameters=int(first["parameters"]),
        multiply_adds=int(first["multiply_adds"]),
        built_in=first["built_in"] == "yes",
        seed=int(first["seed"]),
        epochs=int(first["epochs"]),
        cpu_seconds=float(first["cpu_seconds"]) if first["cpu_seconds"] else None,
        runs=np.mean([[float(x) for x in row["run_ratios"].split()] for row in rows], axis=0),
    )


def spread(networks: list[Network]) -> float:
    """The standard deviation over seeds, pooled over the sizes that were trained from several."""
    groups: dict[tuple[str, int], list[float]] = {}
    for n in networks:
        groups.setdefault((n.network, n.epochs), []).append(n.mean)
    several = [means for means in groups.values() if len(means) > 1]
    if not several:
        return 0.0
    squares = sum(np.var(means) * len(means) for means in several)
    return float(np.sqrt(squares / sum(len(means) - 1 for means in several)))


def ladders(networks: list[Network]) -> dict[str, list[Ladder]]:
    """Of each scene, the longest training first."""
    scenes: dict[str, list[Ladder]] = {}
    for scene in sorted({network.scene for network in networks}):
        mine = sorted((n for n in networks if n.scene == scene), key=lambda n: n.parameters)
        seed = next((n.seed for n in mine if n.built_in), None)
        if seed is None:
            sys.exit(f"{scene}: the table lacks its built-in network; run nst_train.sizes")
        epochs = sorted({n.epochs for n in mine if n.seed == seed}, reverse=True)
        if len(epochs) > len(STYLES):
            sys.exit(
                f"{scene}: trained for {epochs} epochs, but the chart has {len(STYLES)} styles of curves"
            )
        scenes[scene] = [
            Ladder(
                [n for n in mine if n.epochs == count and n.seed == seed],
                [n for n in mine if n.epochs == count and n.seed != seed],
                spread(mine),
            )
            for count in epochs
        ]
    return scenes


def draw(scenes: dict[str, list[Ladder]]) -> bytes:
    """The chart's SVG, one panel for each scene."""
    columns = min(3, len(scenes))
    rows = -(-len(scenes) // columns)
    size = (3.5 * columns, 3.1 * rows + 0.3)
    figure, axes = plt.subplots(rows, columns, figsize=size, layout="constrained", squeeze=False)
    everything = [n for each in scenes.values() for ladder in each for n in ladder.networks]
    sizes = dict(sorted({n.parameters: n.hidden for n in everything}.items()))
    for panel in axes.flat[len(scenes) :]:
        panel.set_visible(False)
    for (scene, each), panel in zip(scenes.items(), axes.flat, strict=False):
        for ladder, style in zip(each, STYLES, strict=False):
            draw_ladder(panel, ladder, *style)
        panel.set_xscale("log")
        labels = [f"{hidden}\n{count:,}" for count, hidden in sizes.items()]
        panel.set_xticks(list(sizes), labels, fontsize=7)
        panel.minorticks_off()
        panel.set_xlim(min(sizes) / 1.5, max(sizes) * 1.5)
        panel.set_title(scene, fontsize=10)
        panel.set_xlabel("hidden layers × width, parameters")
        panel.set_ylabel("MSE(T)/MSE(S), mean over n")
        panel.grid(which="major", color="#dddddd", linewidth=0.6)
        panel.legend(frameon=False, fontsize=8)
    svg = io.BytesIO()
    figure.savefig(svg, metadata={"Date": None})
    plt.close(figure)
    return with_dark_colors(svg.getvalue())


def draw_ladder(panel: plt.Axes, ladder: Ladder, color: str, line: str, marker: str, inside: str) -> None:
    """One curve: its bars are the noise of the difference to its best point."""
    panel.errorbar(
        [n.parameters for n in ladder.networks],
        [n.mean for n in ladder.networks],
        yerr=[ladder.behind(n)[1] for n in ladder.networks],
        color=color,
        linestyle=line,
        marker=marker,
        markersize=5,
        markerfacecolor=inside,
        capsize=3,
        linewidth=1.4,
        label=f"{ladder.best.epochs} epochs",
    )
    if ladder.others:
        x, y = [n.parameters for n in ladder.others], [n.mean for n in ladder.others]
        panel.plot(x, y, color=color, linestyle="none", marker="x", markersize=5, label="other seeds")
    if built_in := ladder.built_in:
        ring = {"marker": "o", "markersize": 12, "markerfacecolor": "none", "color": "#000000"}
        panel.plot(built_in.parameters, built_in.mean, linestyle="none", label="built in", **ring)


def with_dark_colors(svg: bytes) -> bytes:
    """Adds the colours for dark pages."""
    rules = ["text { fill: #e6edf3 }"]
    for what in ("fill", "stroke"):
        rules += [
            f'[style*="{what}: {light}"] {{ {what}: {dark} !important }}' for light, dark in DARK.items()
        ]
    style = "\n@media (prefers-color-scheme: dark) {\n" + "\n".join(rules) + "\n}\n</style>"
    changed = svg.replace(b"</style>", style.encode(), 1)
    assert changed != svg
    return changed


def score_table(scenes: dict[str, list[Ladder]]) -> str:
    """A row for each ladder, a column for each size."""
    everything = [n for each in scenes.values() for ladder in each for n in ladder.networks]
    sizes = list(dict(sorted({n.parameters: n.hidden for n in everything}.items())).values())
    lines = ["| scene | epochs | " + " | ".join(sizes) + " |", "|---" * (2 + len(sizes)) + "|"]
    for scene, each in scenes.items():
        for ladder in each:
            cells = dict.fromkeys(sizes, "–")
            for n in ladder.networks:
                mark = "**" if n is ladder.enough else ""
                cells[n.hidden] = f"{mark}{n.mean:.3f}{mark}" + ("†" if n.built_in else "")
            lines.append(f"| `{scene}` | {ladder.best.epochs} | " + " | ".join(cells.values()) + " |")
    return "\n".join(lines)


def size_table(networks: list[Network]) -> str:
    """What a size costs."""
    scene = min(n.scene for n in networks)
    lines = [
        f"| hidden | network | parameters | multiply-adds | s per epoch, `{scene}` |",
        "|---" * 5 + "|",
    ]
    for parameters in sorted({n.parameters for n in networks}):
        mine = [n for n in networks if n.parameters == parameters]
        known = [n for n in mine if n.cpu_seconds is not None and n.scene == scene]
        longest = max(known, key=lambda n: n.epochs, default=None)
        seconds = "–" if longest is None else f"{longest.cpu_seconds / longest.epochs:.2g}"
        row = (mine[0].hidden, mine[0].network, f"{parameters:,}", f"{mine[0].multiply_adds:,}", seconds)
        lines.append("| " + " | ".join(row) + " |")
    return "\n".join(lines)


def verdicts(scenes: dict[str, list[Ladder]]) -> str:
    """What the numbers say of each scene."""
    lines = []
    for scene, each in scenes.items():
        seeds = "" if each[0].spread else " No other seed was tried."
        lines.append(f"- `{scene}`: {'; '.join(map(verdict, each))}.{seeds}")
    return "\n".join(lines)


def verdict(ladder: Ladder) -> str:
    """Which size is enough, and whether the built-in network is that one."""
    best, enough, built_in = ladder.best, ladder.enough, ladder.built_in
    tried = ", ".join(n.hidden for n in ladder.networks)
    text = f"{best.epochs} epochs ({tried}): "
    if best is ladder.networks[0]:
        text += f"{best.hidden}, the smallest, is the best"
    elif enough is best:
        text += f"{best.hidden} is the best, and no smaller one is within noise of it"
    else:
        text += f"{enough.hidden} is the smallest within noise of the best, {best.hidden}"
        text += " ({:+.4f} ± {:.4f})".format(*ladder.behind(enough))
    if best is ladder.networks[-1]:
        text += ", but that is the largest one trained"
    if built_in is None:
        return text
    text += f"; the built-in network, {built_in.hidden}, is "
    if built_in is enough:
        return text + "that one"
    if built_in.parameters > enough.parameters:
        return text + "**larger than it needs to be**"
    return text + "**smaller than that** ({:+.4f} ± {:.4f} to the best)".format(*ladder.behind(built_in))


def with_blocks(page: str, path: Path, blocks: dict[str, str]) -> str:
    """The page with other lines between `<!-- NAME -->` and `<!-- end of NAME -->`."""
    for name, content in blocks.items():
        begin, end = f"<!-- {name} -->\n", f"<!-- end of {name} -->"
        pattern = re.compile(re.escape(begin) + ".*?" + re.escape(end), re.DOTALL)
        page, count = pattern.subn(lambda _, new=f"{begin}{content}\n{end}": new, page)
        if count != 1:
            sys.exit(f"{path}: expected one pair of markers {begin.strip()} … {end}")
    return page


def main(argv: list[str] | None = None) -> None:
    """`argv` is for tests; without it, the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("table", type=Path, help="docs/sizes.csv")
    parser.add_argument("chart", type=Path, help="docs/sizes.svg")
    parser.add_argument("page", type=Path, help="docs/sizes.md")
    parser.add_argument("--check", action="store_true", help="compare instead of writing")
    a = parser.parse_args(argv)
    networks = read(a.table)
    scenes = ladders(networks)
    contents = (score_table(scenes), verdicts(scenes), size_table(networks))
    blocks = dict(zip(BLOCKS, contents, strict=True))
    page = a.page.read_text(encoding="utf-8")
    svg, made = draw(scenes), with_blocks(page, a.page, blocks)
    if not a.check:
        a.chart.write_bytes(svg)
        a.page.write_text(made, encoding="utf-8")
    elif not a.chart.is_file() or a.chart.read_bytes() != svg:
        sys.exit(f"{a.chart}: not what {a.table} gives; run docs/sizes.py")
    elif made != page:
        sys.exit(f"{a.page}: not what {a.table} gives; run docs/sizes.py")


if __name__ == "__main__":
    main()
