"""Draws Aitken's method on step functions, figure 1 of the paper, from the stability suite's table.

    "$(tools/python-env docs/requirements.txt)" docs/aitken.py docs/stability.csv docs/aitken.svg

The same table gives the same bytes.
"""

import csv
import sys

import matplotlib

matplotlib.use("svg")
# The same file from the same table: no random identifiers, no date; text stays text.
matplotlib.rcParams.update({"svg.hashsalt": "nst", "svg.fonttype": "none", "font.size": 10})

import matplotlib.pyplot as plt  # noqa: E402

CURVES = [("none", "$S_n$", "#0072b2", "o"), ("aitken", "$T_n$, Aitken's Δ²", "#d55e00", "s")]


def main(table: str, chart: str) -> None:
    with open(table, newline="", encoding="utf-8") as file:
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
    figure.savefig(chart, metadata={"Date": None})


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
