"""Draws Aitken's method on step functions, figure 1 of the paper, from the stability suite's table.

    "$(tools/python-env)" docs/aitken.py docs/stability.csv docs/aitken.svg            # draws it
    "$(tools/python-env)" docs/aitken.py docs/stability.csv docs/aitken.svg --check    # compares

The same table gives the same bytes. With --check, exit code 1 if the chart is another one.
"""

import argparse
import csv
import io
import sys
from pathlib import Path

import matplotlib

matplotlib.use("svg")
# The same file from the same table: no random identifiers, no date; text stays text.
matplotlib.rcParams.update({"svg.hashsalt": "nst", "svg.fonttype": "none", "font.size": 10})

import matplotlib.pyplot as plt  # noqa: E402

CURVES = [("none", "$S_n$", "#0072b2", "o"), ("aitken", "$T_n$, Aitken's Δ²", "#d55e00", "s")]


def draw(table: Path) -> bytes:
    """The chart's SVG."""
    with table.open(newline="", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["regime"] == "step"]
    figure, axes = plt.subplots(figsize=(5.0, 3.4), layout="constrained")
    for method, label, color, marker in CURVES:
        curve = [row for row in rows if row["method"] == method and int(row["n"]) <= 4096]
        n = [int(row["n"]) for row in curve]
        mse = [float(row["mse"]) for row in curve]
        axes.loglog(n, mse, color=color, marker=marker, markersize=4, label=label)
    axes.set_xscale("log", base=2)
    axes.set_xlabel("samples n")
    axes.set_ylabel("MSE = mean (x − I)²")
    axes.set_title("Step functions, 9 integrands × 1000 runs", fontsize=10)
    axes.grid(which="major", color="#dddddd", linewidth=0.6)
    axes.legend(frameon=False)
    svg = io.BytesIO()
    figure.savefig(svg, metadata={"Date": None})
    return svg.getvalue()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("table", type=Path, help="docs/stability.csv")
    parser.add_argument("chart", type=Path, help="docs/aitken.svg")
    parser.add_argument("--check", action="store_true", help="compare instead of writing")
    a = parser.parse_args()
    svg = draw(a.table)
    if not a.check:
        a.chart.write_bytes(svg)
    elif a.chart.read_bytes() != svg:
        sys.exit(f"{a.chart}: not what {a.table} gives; run docs/aitken.py")


if __name__ == "__main__":
    main()
