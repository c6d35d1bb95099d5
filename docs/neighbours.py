"""Measures the guard with neighbours, `--transform auto`, on scenes with features.

    python docs/neighbours.py            # writes the tables of docs/neighbours.csv into docs/neighbours.md
    python docs/neighbours.py --check    # compares instead; exit code 1 on a difference
    P="$(tools/python-env docs/requirements-neighbours.txt)"
    $P docs/neighbours.py --make         # first: references and sequences, below the user's cache folder
    $P docs/neighbours.py --measure [METHOD…]

All goes on where it was cut off. `--set tuning` before these takes other scenes, by which parameters are
chosen, and a table in the cache folder, which is printed; `--scene NAME` takes one scene. The environment
variable NST names the program, else it is target/release/nst; NST_CYCLES_PYTHON names the Python that has
Blender's module (see tests/peers/requirements-cycles.txt), without which that scene is left out. Mitsuba
needs LLVM 19, as tests/peers/README.md says.

Errors are (x − R1)(x − R2) with two independent halves of a reference, so that its noise is no part of them;
relMSE divides by R² + 0.01 with R = (R1 + R2)/2.
"""

import argparse
import csv
import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from statistics import fmean, geometric_mean
from typing import TYPE_CHECKING

from page import fill

if TYPE_CHECKING:
    import numpy as np

ROOT = Path(__file__).resolve().parent.parent
DOCS = ROOT / "docs"
PAGE = DOCS / "neighbours.md"
NST = os.environ.get("NST", str(ROOT / "target" / "release" / "nst"))
CACHE = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "nst" / "neighbours"

OURS = ["teapot-glossy", "teapot-diffuse", "cornell", "many-lights", "caustic"]
MITSUBA = [
    "cornell",
    "cornell-direct",
    "cornell-glossy",
    "textures",
    "gloss",
    "glass",
    "focus",
    "sticks",
    "lamps",
]
CYCLES = ["cycles"]
TUNING_OURS = ["plane-ggx", "plane-lambert"]
TUNING_MITSUBA = ["hall", "outdoors", "metal", "pool", "fence", "bulbs", "still-life", "direct"]
SCENES = {
    "test": [*OURS, *(f"mitsuba-{name}" for name in MITSUBA), *CYCLES],
    "tuning": [*(f"tuning-{name}" for name in TUNING_MITSUBA), *TUNING_OURS],
}
COUNTS = [8, 32, 128, 1024]
RUNS = 2
# Samples per pixel of each half of a reference.
REFERENCE_SPP = {"test": 2048, "tuning": 1024}
# Samples of the references, at most, and sequences (samples, run), in the order in which they are made: what
# is cheap comes first.
STAGES = [
    (256, [(8, 0), (32, 0)]),
    (1024, [(128, 0), (1024, 0)]),
    (1024, [(count, run) for run in range(1, RUNS) for count in COUNTS]),
    (max(REFERENCE_SPP.values()), []),
]

PLAIN, OIDN = "S", "OIDN"
# Options of `nst transform`; OIDN alone is called by Python.
METHODS: dict[str, list[str]] = {
    PLAIN: ["--transform", "none"],
    OIDN: [],
    "filter alone": ["--transform", "filter"],
    **{
        f"auto {experts}": ["--transform", "auto", "--experts", experts]
        for experts in ("lane", "filter", "lane,filter", "filter,oidn", "lane,filter,oidn")
    },
}
METRICS = ["mse", "relmse"]
PREDICTED = ["predicted_ratio", "predicted_low", "predicted_high"]
COLUMNS = ["scene", "spp", "run", "method", *METRICS, *PREDICTED]


def table_of(chosen: str) -> Path:
    return DOCS / "neighbours.csv" if chosen == "test" else CACHE / f"{chosen}.csv"


def read(path: Path) -> list[dict[str, str]]:
    if not path.is_file():
        return []
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def make(chosen: str, scenes: list[str], stages: int) -> None:
    import neighbours_make as maker

    def renderer(scene: str) -> Callable[[], maker.Renderer]:
        if scene in CYCLES:
            return maker.Cycles
        if scene in OURS + TUNING_OURS:
            return lambda: maker.Ours(scene)
        return lambda: maker.Mitsuba(scene)

    if not maker.CYCLES_PYTHON:
        scenes = [scene for scene in scenes if scene not in CYCLES]
    wanted = [(min(spp, REFERENCE_SPP[chosen]), sequences) for spp, sequences in STAGES[:stages]]
    maker.make({scene: renderer(scene) for scene in scenes}, CACHE, wanted)


def transformed(sequence: Path, picture: Path, options: list[str]) -> dict[str, float | None]:
    """Writes the picture; returns the report."""
    command = [NST, "transform", str(sequence), *options, "--json", "-o", str(picture)]
    return json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)


def estimated(sequence: Path, method: str) -> tuple["np.ndarray", dict[str, float | None]]:
    """Colours `[y, x, color]`, and what was predicted of them."""
    import numpy as np
    import pyoidn
    from neighbours_make import layers, stacked

    if method == OIDN:
        channels = layers(sequence)
        pair = stacked(channels), np.clip(stacked(channels, "albedo"), 0, 1)
        return pyoidn.denoise(*pair, stacked(channels, "normal", "XYZ"), hdr=True), {}
    with tempfile.TemporaryDirectory() as folder:
        picture = Path(folder) / "picture.exr"
        report = transformed(sequence, picture, METHODS[method])
        return stacked(layers(picture)), {name: report[name] for name in PREDICTED}


def halves(scene: str) -> list["np.ndarray"]:
    """Of the reference, in f64."""
    from neighbours_make import layers, stacked

    return [stacked(layers(CACHE / scene / f"reference-{i}.exr")).astype("f8") for i in (0, 1)]


def errors(colors: "np.ndarray", halves: list["np.ndarray"]) -> list[float]:
    """One for each of `METRICS`."""
    squares = (colors - halves[0]) * (colors - halves[1])
    relative = squares / (((halves[0] + halves[1]) / 2) ** 2 + 0.01)
    return [float(squares.mean()), float(relative.mean())]


def measured(sequence: Path, method: str) -> list[str]:
    """Errors and what was predicted, as in the table."""
    colors, predicted = estimated(sequence, method)
    values = [*errors(colors, halves(sequence.parent.name)), *map(predicted.get, PREDICTED)]
    return ["" if value is None else f"{value:.6g}" for value in values]


def has_reference(chosen: str, scene: str) -> bool:
    """Whether all of it is there: rows of the table are to be of one and the same reference."""
    from neighbours_make import samples

    paths = [CACHE / scene / f"reference-{i}.exr" for i in (0, 1)]
    return all(path.is_file() and samples(path) >= REFERENCE_SPP[chosen] for path in paths)


def measure(chosen: str, scenes: list[str], methods: list[str]) -> None:
    for scene in scenes:
        if not has_reference(chosen, scene):
            print(f"{scene}: its reference is not finished; it is left out", file=sys.stderr)
    scenes = [scene for scene in scenes if has_reference(chosen, scene)]
    path = table_of(chosen)
    done = {(row["scene"], row["spp"], row["run"], row["method"]) for row in read(path)}
    new = not path.is_file()
    with path.open("a", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        if new:
            writer.writerow(COLUMNS)
        for scene, spp, run, method in product(scenes, COUNTS, range(RUNS), methods):
            sequence = CACHE / scene / f"{spp}-{run}.exr"
            if (scene, str(spp), str(run), method) not in done and sequence.is_file():
                writer.writerow([scene, spp, run, method, *measured(sequence, method)])
                file.flush()


@dataclass
class Measured:
    """The rows of a table."""

    rows: list[dict[str, str]]

    def mean(self, metric: str, scene: str, spp: int, method: str) -> float:
        key = scene, str(spp), method
        values = [float(r[metric]) for r in self.rows if key == (r["scene"], r["spp"], r["method"])]
        return fmean(values) if values else math.nan

    def ratio(self, metric: str, scene: str, spp: int, method: str, to: tuple[str, ...]) -> float:
        """To the least of these methods, of means over the runs."""
        least = min(self.mean(metric, scene, spp, other) for other in to)
        return self.mean(metric, scene, spp, method) / least


def cells(values: list[str]) -> str:
    return "| " + " | ".join(values) + " |"


def number(value: float) -> str:
    if math.isnan(value):
        return "–"
    return f"{value:.3g}" if value >= 10 else f"{value:.3f}"


def both(values: list[float]) -> str:
    return " / ".join(map(number, values))


def known_places(data: Measured, scenes: list[str]) -> list[tuple[str, int]]:
    return [place for place in product(scenes, COUNTS) if not math.isnan(data.mean("mse", *place, PLAIN))]


def methods_of(rows: list[dict[str, str]]) -> list[str]:
    return [name for name in METHODS if name != PLAIN and any(row["method"] == name for row in rows)]


def ratios(rows: list[dict[str, str]], scenes: list[str]) -> list[str]:
    """MSE / relMSE of each method over that of S."""
    data, methods = Measured(rows), methods_of(rows)
    lines = [cells(["scene", "spp", *methods]), "|---" * (2 + len(methods)) + "|"]
    for scene, spp in known_places(data, scenes):
        of_methods = [[data.ratio(m, scene, spp, method, (PLAIN,)) for m in METRICS] for method in methods]
        lines.append(cells([f"`{scene}`", str(spp), *map(both, of_methods)]))
    return lines


def summaries(rows: list[dict[str, str]], scenes: list[str]) -> list[str]:
    data, methods = Measured(rows), methods_of(rows)
    lines = [cells(["", *methods]), "|---" * (1 + len(methods)) + "|"]
    for name, to in {"S": (PLAIN,), "the smaller of S and OIDN": (PLAIN, OIDN)}.items():
        for spp in [*COUNTS, None]:
            among = [place for place in known_places(data, scenes) if spp in (None, place[1])]
            if among:
                title = f"/ {name}, " + ("all" if spp is None else f"{spp} spp")
                lines.append(cells([title, *(summary(data, among, method, to) for method in methods)]))
    return lines


def predictions(rows: list[dict[str, str]]) -> list[str]:
    """In how many renderings the interval of the prediction contains the true MSE ratio."""
    plain = {(r["scene"], r["spp"], r["run"]): float(r["mse"]) for r in rows if r["method"] == PLAIN}
    lines = [cells(["method", "renderings", "inside", "true ratio is larger", "smaller"]), "|---" * 5 + "|"]
    for method in methods_of(rows):
        told = [row for row in rows if row["method"] == method and row["predicted_low"]]
        if not told:
            continue
        larger = smaller = 0
        for row in told:
            true = float(row["mse"]) / plain[row["scene"], row["spp"], row["run"]]
            larger += true > float(row["predicted_high"])
            smaller += true < float(row["predicted_low"])
        inside = len(told) - larger - smaller
        counts = [str(len(told)), f"{100 * inside / len(told):.1f} %", str(larger), str(smaller)]
        lines.append(cells([f"`{method}`", *counts]))
    return lines


def show(chosen: str, scenes: list[str], check: bool) -> int:
    rows = read(table_of(chosen))
    blocks = {
        "ratios": ratios(rows, scenes),
        "summaries": summaries(rows, scenes),
        "predictions": predictions(rows),
    }
    if chosen != "test":
        print("\n\n".join("\n".join(lines) for lines in blocks.values()))
        return 0
    return fill(PAGE, blocks, __file__, check)


def summary(data: Measured, places: list[tuple[str, int]], method: str, to: tuple[str, ...]) -> str:
    """Geometric means, and the largest."""
    ratios = [[data.ratio(metric, *place, method, to) for place in places] for metric in METRICS]
    known = [[value for value in values if not math.isnan(value)] for values in ratios]
    if not all(known):
        return "–"
    return f"{both([geometric_mean(v) for v in known])}, at most {both([max(v) for v in known])}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--set", choices=SCENES, default="test", dest="chosen")
    parser.add_argument("--scene", action="append", metavar="NAME")
    parser.add_argument("--make", action="store_true")
    parser.add_argument("--stages", type=int, default=len(STAGES), metavar="N", help="make only the first N")
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--measure", nargs="*", metavar="METHOD", help=", ".join(METHODS))
    args = parser.parse_args()
    known = SCENES[args.chosen]
    scenes = args.scene or known
    if unknown := {*scenes} - {*known} | {*(args.measure or [])} - METHODS.keys():
        parser.error(f"unknown: {', '.join(sorted(unknown))}; scenes are {', '.join(known)}")
    if args.make:
        make(args.chosen, scenes, args.stages)
    if args.measure is not None:
        measure(args.chosen, scenes, args.measure or list(METHODS))
    if not args.make and args.measure is None:
        return show(args.chosen, scenes, args.check)
    return 0


if __name__ == "__main__":
    sys.exit(main())
