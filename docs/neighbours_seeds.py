"""Was it chance? Ten other renderings of what the guard over neighbours made worse, for docs/neighbours.md.

    "$(tools/python-env docs/requirements-neighbours.txt)" docs/neighbours_seeds.py --measure FOLDER
    python docs/neighbours_seeds.py            # writes the tables into the page
    python docs/neighbours_seeds.py --check    # compares instead; exit code 1 on a difference

They are those of docs/neighbours-random.csv, whose scenes and references are in FOLDER (see
docs/neighbours_random.py), and those of `caustic`, whose reference docs/neighbours.py has made. `--measure`
uses target/release/nst, or the binary that the environment variable NST names, and goes on where it was cut
off. docs/neighbours-seeds.csv has a row for each rendering and method, with errors as docs/neighbours.py has
them.
"""

import csv
import sys
import tempfile
from collections.abc import Callable
from itertools import product
from math import sqrt
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING

import neighbours_random as of_one
from neighbours import DOCS, METRICS, OIDN, PAGE, PLAIN, errors, estimated, halves, read
from page import command

if TYPE_CHECKING:
    import numpy as np

TABLE = DOCS / "neighbours-seeds.csv"
COLUMNS = ["scene", "spp", "seed", "method", *METRICS]
SEEDS = range(1, 11)
# Where the largest ratios are, beside the better of S and OIDN.
CAUSTIC, COUNTS = "caustic", [8, 32, 128]
OF_CAUSTIC = [PLAIN, OIDN, "auto filter,oidn", "auto lane,filter,oidn"]
# The runs of docs/neighbours.csv have the numbers before.
FIRST_RUN = 2
# Seeds of a scene that differ by so much share no sample with any sequence or reference of the set.
STEP = 10_000

Picture = tuple[str, str]
"""A scene, and samples per pixel."""


def harmed() -> dict[Picture, list[tuple[str, str]]]:
    """What was worse than S in one rendering: by picture, methods and metrics."""
    found: dict[Picture, list[tuple[str, str]]] = {}
    for row in read(of_one.TABLE):
        for metric in METRICS:
            if float(row[metric]) > of_one.LIMIT:
                found.setdefault((row["scene"], row["spp"]), []).append((row["method"], metric))
    return found


def measure(folder: Path) -> None:
    sys.path.append(str(DOCS.parent / "train"))
    from nst_train.guard_data.read import pictures

    for spp in COUNTS:
        measure_one((CAUSTIC, str(spp)), OF_CAUSTIC, halves(CAUSTIC), of_caustic(spp))
    wanted = harmed()
    for picture in pictures(folder):
        key = picture.scene, str(picture.spp)
        if key in wanted:
            methods = [PLAIN, *dict.fromkeys(method for method, _ in wanted[key])]
            measure_one(key, methods, list(picture.halves()), of_random(*key))


def of_caustic(spp: int) -> Callable[[int, Path], None]:
    """Renders it with another seed."""
    from neighbours_make import Ours

    return lambda seed, path: Ours(CAUSTIC).sequence(spp, FIRST_RUN + seed, path)


def of_random(scene: str, spp: str) -> Callable[[int, Path], None]:
    """The same of a random scene."""
    from nst_train import random_scenes
    from nst_train.guard_data.make import Work
    from nst_train.guard_data.plan import SEED, SIZE, plan

    def render(seed: int, path: Path) -> None:
        family, _, index = scene.rpartition("-")
        of_scene = plan(family, int(index))
        obj = random_scenes.write(random_scenes.random_scene(family, int(index), SEED), path.parent)
        options = "--features", "--sequence", path
        number = of_scene.seed_of_sequence(STEP * seed + int(spp))
        Work(of_scene, obj, path.parent, SIZE).render(int(spp), number, of_scene.sampler, *options)

    return render


def measure_one(
    picture: Picture, methods: list[str], reference: list["np.ndarray"], render: Callable[[int, Path], None]
) -> None:
    """Adds rows of a picture, whose reference has two halves; those that are there stay."""
    from neighbours_make import layers, stacked

    new = not TABLE.is_file()
    done = {(row["scene"], row["spp"], row["seed"], row["method"]) for row in read(TABLE)}
    with TABLE.open("a", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        if new:
            writer.writerow(COLUMNS)
        for seed in SEEDS:
            lacking = [method for method in methods if (*picture, str(seed), method) not in done]
            if not lacking:
                continue
            with tempfile.TemporaryDirectory() as temporary:
                sequence = Path(temporary) / "sequence.exr"
                render(seed, sequence)
                for method in lacking:
                    colors = stacked(layers(sequence)) if method == PLAIN else estimated(sequence, method)[0]
                    values = (f"{error:.6g}" for error in errors(colors, reference))
                    writer.writerow([*picture, seed, method, *values])
            file.flush()


class Errors:
    """Those of the table, over seeds."""

    def __init__(self, rows: list[dict[str, str]]) -> None:
        self.of: dict[tuple[Picture, str, str], list[float]] = {}
        for row, metric in product(rows, METRICS):
            key = (row["scene"], row["spp"]), row["method"], metric
            self.of.setdefault(key, []).append(float(row[metric]))

    def ratio(self, picture: Picture, method: str, metric: str, to: str = PLAIN) -> tuple[float, float]:
        """Of means over seeds, with its standard error by the jackknife."""
        above, below = (self.of[picture, name, metric] for name in (method, to))
        pairs, n = list(zip(above, below, strict=True)), len(above)
        total, less = sum(above), sum(below)
        without = [(total - a) / (less - b) for a, b in pairs]
        spread = sum((x - fmean(without)) ** 2 for x in without)
        return total / less, sqrt((n - 1) / n * spread)

    def worse(self, picture: Picture, method: str, metric: str) -> int:
        """In how many seeds."""
        above, below = (self.of[picture, name, metric] for name in (method, PLAIN))
        return sum(a > of_one.LIMIT * b for a, b in zip(above, below, strict=True))


def told(ratio: tuple[float, float]) -> str:
    return f"{ratio[0]:.3f} ± {ratio[1]:.3f}"


def caustic_table(found: Errors) -> list[str]:
    lines = [
        "| spp | method | T/S, MSE | T/S, relMSE | over OIDN, MSE | over OIDN, relMSE |",
        "|---" * 6 + "|",
    ]
    for spp, method in product(COUNTS, OF_CAUSTIC[1:]):
        picture = CAUSTIC, str(spp)
        ratios = [told(found.ratio(picture, method, metric)) for metric in METRICS]
        ratios += [
            "–" if method == OIDN else told(found.ratio(picture, method, metric, OIDN)) for metric in METRICS
        ]
        lines.append(f"| {spp} | `{method}` | " + " | ".join(ratios) + " |")
    return lines


def random_table(found: Errors) -> list[str]:
    """Those that are still worse than S in the mean of other seeds, and how many are not."""
    once = {
        (row["scene"], row["spp"], row["method"], metric): float(row[metric])
        for row, metric in product(read(of_one.TABLE), METRICS)
    }
    cases = [(picture, method, metric) for picture, of in harmed().items() for method, metric in of]
    ratios = {case: found.ratio(*case) for case in cases}
    names = {"mse": "MSE", "relmse": "relMSE"}
    lines = [
        "| picture | experts | metric | T/S of the one rendering | of ten others | worse than 1.02, of ten |",
        "|---" * 6 + "|",
    ]
    above = {case: ratio for case, ratio in ratios.items() if ratio[0] > of_one.LIMIT}
    for (picture, method, metric), ratio in sorted(above.items(), key=lambda item: -item[1][0]):
        cells = [f"`{picture[0]}` {picture[1]} spp", f"`{method.removeprefix('auto ')}`", names[metric]]
        cells += [f"{once[*picture, method, metric]:.2f}", told(ratio)]
        lines.append("| " + " | ".join([*cells, str(found.worse(picture, method, metric))]) + " |")
    clear = sum(ratio - 2 * error > of_one.LIMIT for ratio, error in above.values())
    rest = len(cases) - len(above)
    lines += [
        "",
        f"Of {len(cases)} such cases, {rest} are at most 1.02 in the mean of ten other renderings; of the",
        f"{len(above)} above, {clear} by more than two standard errors.",
    ]
    return lines


def blocks() -> dict[str, list[str]]:
    found = Errors(read(TABLE))
    return {"caustic": caustic_table(found), "seeds": random_table(found)}


def main(argv: list[str]) -> int:
    return command(argv, __file__, __doc__, PAGE, measure, blocks)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
