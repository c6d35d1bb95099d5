"""Measures the guard over neighbours on random scenes, for docs/neighbours.md: does it harm anywhere?

    "$(tools/python-env docs/requirements-neighbours.txt)" docs/neighbours_random.py --measure FOLDER
    python docs/neighbours_random.py            # writes the table into the page
    python docs/neighbours_random.py --check    # compares instead; exit code 1 on a difference

FOLDER is what `python -m nst_train guard-data --folder FOLDER` (train/README.md) has made, all of it or a
part. `--measure` uses target/release/nst, or the binary that the environment variable NST names, and goes on
where it was cut off. docs/neighbours-random.csv has a row for each picture and list of experts: errors,
relative to those of the plain estimate, against a reference of two independent halves.
"""

import csv
import sys
from itertools import product
from pathlib import Path
from statistics import geometric_mean
from typing import TYPE_CHECKING

from neighbours import DOCS, METRICS, PAGE, errors, estimated, read
from page import command

if TYPE_CHECKING:
    import numpy as np

TABLE = DOCS / "neighbours-random.csv"
COLUMNS = ["scene", "spp", "method", "families", *METRICS]
# What the network that weighs experts has never seen, and what it was trained on.
FAMILIES = ["held out", "trained on"]
LISTS = ["auto lane", "auto lane,filter", "auto lane,filter,oidn"]
# Pictures whose reference has more noise than this share of S's errors are not judged.
MOST_NOISE = 0.1
# Where a method counts as worse than S, and how many of the worst are shown.
LIMIT = 1.02
SHOWN = 5


def measure(folder: Path) -> None:
    sys.path.append(str(DOCS.parent / "train"))
    from neighbours_make import layers, stacked

    from nst_train.guard_data.read import OTHERS, pictures

    done = {tuple(row[name] for name in COLUMNS[:3]) for row in read(TABLE)}
    new = not TABLE.is_file()
    with TABLE.open("a", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        if new:
            writer.writerow(COLUMNS)
        for picture in pictures(folder):
            lists = [it for it in LISTS if (picture.scene, str(picture.spp), it) not in done]
            # On those of others, the guard was settled.
            if picture.scene.startswith(OTHERS) or not lists:
                continue
            halves = list(picture.halves())
            plain = errors(stacked(layers(picture.sequence)), halves)
            if is_noisy(halves, plain):
                continue
            families = FAMILIES[0 if picture.held_out else 1]
            for method in lists:
                of_method = errors(estimated(picture.sequence, method)[0], halves)
                ratios = (f"{t / s:.4g}" for t, s in zip(of_method, plain, strict=True))
                writer.writerow([picture.scene, picture.spp, method, families, *ratios])
                file.flush()


def is_noisy(halves: list["np.ndarray"], plain: list[float]) -> bool:
    """Whether a reference has too much noise to judge by, beside S's errors, or S has none."""
    noise = errors(sum(halves) / 2, [halves[0], halves[0]])
    return any(n >= MOST_NOISE * error for n, error in zip(noise, plain, strict=True))


def table(rows: list[dict[str, str]]) -> list[str]:
    """By list of experts, and whether the network that weighs them was trained on the scene's family."""
    lines = [
        "| experts | families | pictures | geometric mean | above 1.02 in MSE | in relMSE "
        "| the largest, MSE / relMSE |"
    ]
    lines.append("|---" * 7 + "|")
    for method, families in product(LISTS, FAMILIES):
        own = [row for row in rows if (row["method"], row["families"]) == (method, families)]
        both = [[float(row[metric]) for row in own] for metric in METRICS]
        # An error that is estimated without bias may come out below 0.
        mean = " / ".join(f"{geometric_mean(max(x, 1e-4) for x in ratios):.3f}" for ratios in both)
        above = " | ".join(str(sum(x > LIMIT for x in ratios)) for ratios in both)
        worst = sorted(own, key=lambda row: max(float(row[metric]) for metric in METRICS), reverse=True)
        named = (
            f"`{row['scene']}` {row['spp']} spp: "
            + " / ".join(f"{float(row[metric]):.2f}" for metric in METRICS)
            for row in worst[:SHOWN]
        )
        name = method.removeprefix("auto ")
        lines.append(f"| `{name}` | {families} | {len(own)} | {mean} | {above} | {'; '.join(named)} |")
    return lines


def main(argv: list[str]) -> int:
    return command(argv, __file__, __doc__, PAGE, measure, lambda: {"random": table(read(TABLE))})


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
