"""Means over several draws of what docs/stability.csv says of one: for docs/adaptation.md.

    python docs/stability_seeds.py            # writes the table into the page
    python docs/stability_seeds.py --check    # compares instead; exit code 1 on a difference
    python docs/stability_seeds.py --measure FOLDER   # the CSV, first; some minutes for each draw

`--measure` uses target/release/nst, or the binary that the environment variable NST names, and goes on where
it was cut off: FOLDER has a table of `nst bench stability --seed K` for each draw. docs/stability-seeds.csv
has the guard's rows of them.
"""

import csv
import os
import subprocess
import sys
from pathlib import Path

from page import command

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "adaptation.md"
TABLE = ROOT / "docs" / "stability-seeds.csv"
NST = os.environ.get("NST", str(ROOT / "target" / "release" / "nst"))
# No parameter of a method was chosen by any of these draws.
SEEDS = range(1, 9)
METHODS = {"auto": "the guard", "guard-samples": "over networks"}
COUNTS = [8, 16, 32, 64]
COLUMNS = ["seed", "method", "regime", "n", "mse", "mse_ratio"]
# Lanes whose S is not finite, and infinite variances, have no mean to speak of.
LEFT_OUT = {"nonfinite", "pareto"}


def measure(folder: Path) -> None:
    rows = []
    for seed in SEEDS:
        table = folder / f"{seed}.csv"
        if not table.exists():
            subprocess.run(
                [NST, "bench", "stability", "--seed", str(seed), "-o", table, "--quiet"], check=True
            )
        with table.open(newline="", encoding="utf-8") as file:
            of_seed = [row | {"seed": seed} for row in csv.DictReader(file) if row["method"] in METHODS]
        rows += [{key: row[key] for key in COLUMNS} for row in of_seed]
    with TABLE.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def ratio(rows: list[dict[str, str]]) -> float:
    """Of the sums over draws: Σ MSE of T / Σ MSE of S."""
    of_t = [float(row["mse"]) for row in rows]
    # Where T is S, however small that is, it says so by the ratio.
    of_s = [float(row["mse"]) / float(row["mse_ratio"]) if float(row["mse"]) else 0.0 for row in rows]
    return sum(of_t) / sum(of_s) if sum(of_s) else 1.0


def blocks() -> dict[str, list[str]]:
    with TABLE.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    regimes = list(dict.fromkeys(row["regime"] for row in rows if row["regime"] not in LEFT_OUT))
    head = [f"{name}, n = {n}" for name in METHODS.values() for n in COUNTS]
    lines = [
        "| regime | " + " | ".join(head) + " | largest of any n | largest of any draw |",
        "|---|" + "---|" * (len(head) + 2),
    ]
    for regime in regimes:
        own = [row for row in rows if row["regime"] == regime]
        pairs = {(row["method"], int(row["n"])) for row in own}
        means = {
            pair: ratio([row for row in own if (row["method"], int(row["n"])) == pair]) for pair in pairs
        }
        cells = [means[method, n] for method in METHODS for n in COUNTS]
        cells += [max(means.values()), max(float(row["mse_ratio"]) for row in own)]
        if min(cells) < 1 or max(cells) > 1:
            lines.append(f"| `{regime}` | " + " | ".join(f"{cell:.3f}" for cell in cells) + " |")
    return {"draws": lines}


if __name__ == "__main__":
    sys.exit(command(sys.argv[1:], "docs/stability_seeds.py", __doc__, PAGE, measure, blocks))
