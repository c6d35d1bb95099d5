"""Log-log charts of MSE against n as SVG; the same numbers give the same bytes."""

from dataclasses import dataclass
from pathlib import Path

import matplotlib

matplotlib.use("svg")
# No random identifiers, no date; text stays text.
matplotlib.rcParams.update({"svg.hashsalt": "nst", "svg.fonttype": "none", "font.size": 9})

import matplotlib.pyplot as plt  # noqa: E402
from matplotlib.ticker import NullLocator  # noqa: E402

PANEL = (3.4, 3.0)  # inches
TICKS = (8, 16, 32, 64)


@dataclass(frozen=True)
class Style:
    """How a curve looks, in all charts. Colours that colour-blind readers can tell apart."""

    color: str
    line: str = "-"
    width: float = 1.6


@dataclass(frozen=True)
class Curve:
    """MSE at some n."""

    label: str
    style: Style
    n: list[int]
    mse: list[float]


@dataclass(frozen=True)
class Panel:
    """One chart of a figure."""

    title: str
    curves: list[Curve]


def draw(panels: list[Panel], path: Path) -> None:
    """Panels side by side, at most three in a row, with one legend below."""
    columns = min(len(panels), 3 if len(panels) != 4 else 2)
    rows = -(-len(panels) // columns)
    size = (PANEL[0] * columns, PANEL[1] * rows + 0.5)
    figure, axes = plt.subplots(rows, columns, figsize=size, layout="constrained", squeeze=False)
    handles = {}
    for panel, ax in zip(panels, axes.flat, strict=True):
        for curve in panel.curves:
            (line,) = ax.loglog(
                curve.n,
                curve.mse,
                color=curve.style.color,
                linestyle=curve.style.line,
                linewidth=curve.style.width,
            )
            handles.setdefault(curve.label, line)
        ax.set_title(panel.title, fontsize=10)
        ax.set_xlabel("samples n")
        ax.set_ylabel("MSE")
        shown = [n for n in TICKS if any(n in curve.n for curve in panel.curves)]
        ax.set_xticks(shown, [str(n) for n in shown])
        ax.xaxis.set_minor_locator(NullLocator())
        ax.grid(which="major", color="#dddddd", linewidth=0.6)
    figure.legend(handles.values(), handles.keys(), loc="outside lower center", ncols=5, frameon=False)
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)
