"""Measures `--transform auto --experts lane` on scenes that it has never seen, for docs/adaptation.md.

    python docs/adaptation.py            # writes the tables into the page
    python docs/adaptation.py --check    # compares instead; exit code 1 on a difference
    "$(tools/python-env docs/requirements-denoise.txt)" docs/adaptation.py --measure    # the CSVs, first

`--measure` uses target/release/nst, or the binary that the environment variable NST names, and goes on where
it was cut off. docs/adaptation.csv has a row for each rendering and method: errors against a reference of two
independent halves, and what the guard predicted. docs/adaptation-errors.csv compares the layer `StdError`
with the true errors, by tenths of the lanes from dark to bright.
"""

import csv
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from itertools import product
from pathlib import Path
from statistics import fmean, geometric_mean

import numpy as np
from page import fill

ROOT = Path(__file__).resolve().parent.parent
NST = os.environ.get("NST", str(ROOT / "target" / "release" / "nst"))
DOCS = ROOT / "docs"
TABLE = DOCS / "adaptation.csv"
ERRORS = DOCS / "adaptation-errors.csv"
PAGE = DOCS / "adaptation.md"

# Each scene's options, and the network that was trained on it. The paper's scenes have no anti-aliasing.
CENTER = ["--pixel", "center"]
SCENES = {
    "caustic": ([], None),
    "cornell": ([], "cornell-depth-8"),
    "cornell-direct": (["--max-depth", "2"], "cornell-direct"),
    "many-lights": ([], None),
    "plane-ggx": (CENTER, "plane-ggx"),
    "plane-lambert": (CENTER, "plane-lambert"),
    "teapot-diffuse": (CENTER, "teapot-diffuse"),
    "teapot-glossy": (CENTER, "teapot-glossy"),
}
SIZE = "128x128"
COUNTS = {"random": [8, 16, 32, 64, 256, 1024], "halton-folds": [8, 32, 128, 512]}
RUNS = 10
# Of each of the two references; the caustic takes long.
REFERENCE_SPP = {"caustic": 4096}
USUAL_REFERENCE_SPP = 16384
COLUMNS = ["scene", "sampler", "method", "spp", "run", "mse", "relmse", "predicted_ratio"]
COLUMNS += ["predicted_low", "predicted_high"]
PLAIN, AUTO = "none", "auto: lane"
# No neighbours: lanes are judged one by one.
LANE = ["--transform", "auto", "--experts", "lane"]
# The ratio up to which T may be worse than S by chance.
LIMIT = 1.02

# The reference of the errors has other seeds than what it judges.
ERROR_COUNTS = [8, 64]
ERROR_RUNS = 10
ERROR_REFERENCE = ["--spp", "4096", "--transform", "none"]
DECILES = 10
ERROR_COLUMNS = ["scene", "sampler", "spp", "decile", "estimated", "true"]
FACTOR = 1.5


def scene_file(scene: str) -> str:
    name = scene.removesuffix("-direct")
    return str(ROOT / "scenes" / name / f"{name}.obj")


def read(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def append(path: Path, columns: list[str], rows: Iterable[list[object]]) -> None:
    new = not path.is_file()
    with path.open("a", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        if new:
            writer.writerow(columns)
        writer.writerows(rows)


def rounded(text: str) -> str:
    """Six digits are enough."""
    return f"{float(text):.6g}" if text else ""


def bench(scene: str, sampler: str, folder: Path) -> list[list[object]]:
    options, network = SCENES[scene]
    table = folder / f"{scene}-{sampler}.csv"
    command = [NST, "bench", "scene", "--scene", scene_file(scene), "--size", SIZE, *options]
    command += ["--sampler", sampler, "--spp", *map(str, COUNTS[sampler]), "--runs", str(RUNS)]
    command += ["--reference-spp", str(REFERENCE_SPP.get(scene, USUAL_REFERENCE_SPP)), *LANE]
    command += ["--transform", network] if network and sampler == "random" else []
    subprocess.run(
        [*command, "--backend", "cpu", "--quiet", "-o", str(table)], check=True, stdout=subprocess.DEVNULL
    )
    return [
        [scene, *(row[name] for name in COLUMNS[1:5]), *(rounded(row[name]) for name in COLUMNS[5:])]
        for row in read(table)
    ]


def layers(path: Path) -> dict[str, np.ndarray]:
    import OpenEXR

    channels = OpenEXR.File(str(path), separate_channels=True).channels()
    return {name: channel.pixels.astype("f8") for name, channel in channels.items()}


def errors(scene: str, folder: Path) -> list[list[object]]:
    """Mean squares of `StdError` and of the true errors, by tenths of the lanes."""

    def render(name: str, seed: int, *options: str) -> dict[str, np.ndarray]:
        path = folder / f"{scene}-{name}.exr"
        command = [NST, "render", "--scene", scene_file(scene), "--size", SIZE, *SCENES[scene][0]]
        command += ["--seed", str(seed), *options, "--quiet", "-o", str(path)]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        return layers(path)

    def colors(picture: dict[str, np.ndarray], prefix: str = "") -> np.ndarray:
        return np.stack([picture[prefix + color] for color in "RGB"]).ravel()

    halves = [colors(render(f"reference-{i}", 2_000_000 + i, *ERROR_REFERENCE)) for i in (0, 1)]
    # Lanes that no light reaches have no error.
    order = np.argsort(sum(halves), kind="stable")
    order = order[np.count_nonzero(sum(halves) == 0) :]
    rows = []
    for sampler, spp in product(COUNTS, ERROR_COUNTS):
        sums = np.zeros([2, DECILES])
        for run in range(ERROR_RUNS):
            picture = render(f"{spp}", 3_000_000 + run, "--sampler", sampler, "--spp", str(spp), *LANE)
            estimate = colors(picture)
            true = (estimate - halves[0]) * (estimate - halves[1])
            both = colors(picture, "StdError.") ** 2, true
            for i, values in enumerate(both):
                sums[i] += [values[part].mean() for part in np.array_split(order, DECILES)]
        for decile, (estimated, true) in enumerate(sums.T / ERROR_RUNS):
            rows.append([scene, sampler, spp, decile, f"{estimated:.6g}", f"{true:.6g}"])
    return rows


def measure() -> None:
    done = {(row["scene"], row["sampler"]) for row in read(TABLE)} if TABLE.is_file() else set()
    known = {row["scene"] for row in read(ERRORS)} if ERRORS.is_file() else set()
    with tempfile.TemporaryDirectory() as name:
        for scene in SCENES:
            for sampler in COUNTS:
                if (scene, sampler) not in done:
                    print(scene, sampler, flush=True)
                    append(TABLE, COLUMNS, bench(scene, sampler, Path(name)))
            if scene not in known:
                print(scene, "errors", flush=True)
                append(ERRORS, ERROR_COLUMNS, errors(scene, Path(name)))


class Measured:
    """The rows of docs/adaptation.csv."""

    def __init__(self) -> None:
        self.rows = read(TABLE)

    def mean(self, metric: str, *key: str) -> float:
        values = [
            float(r[metric]) for r in self.rows if key == (r["scene"], r["sampler"], r["method"], r["spp"])
        ]
        return fmean(values) if values else math.nan

    def ratio(self, metric: str, scene: str, sampler: str, method: str, spp: int) -> float:
        """Of the mean errors of a method and of S."""
        of_method = self.mean(metric, scene, sampler, method, str(spp))
        return of_method / self.mean(metric, scene, sampler, PLAIN, str(spp))

    def table(self, sampler: str) -> list[str]:
        counts = COUNTS[sampler]
        networks = sampler == "random"
        head = ["scene", *(f"{spp} spp" for spp in counts), *(["its network, 32 spp"] if networks else [])]
        lines = ["| " + " | ".join(head) + " |", "|---" * len(head) + "|"]
        ratios: dict[tuple[str, int], list[float]] = {}
        for scene, (_, network) in SCENES.items():
            cells = []
            for spp in counts:
                both = [self.ratio(metric, scene, sampler, AUTO, spp) for metric in ("mse", "relmse")]
                for metric, ratio in zip(("mse", "relmse"), both, strict=True):
                    ratios.setdefault((metric, spp), []).append(ratio)
                cells.append(" / ".join(f"{ratio:.3f}" for ratio in both))
            if networks:
                both = [self.ratio(metric, scene, sampler, network or "", 32) for metric in ("mse", "relmse")]
                cells.append(" / ".join(f"{ratio:.3f}" for ratio in both) if network else "–")
            lines.append(f"| `{scene}` | " + " | ".join(cells) + " |")
        means = [[geometric_mean(ratios[metric, spp]) for metric in ("mse", "relmse")] for spp in counts]
        cells = [" / ".join(f"{mean:.3f}" for mean in both) for both in means] + ([""] if networks else [])
        lines.append("| geometric mean | " + " | ".join(cells) + " |")
        everything = [ratio for of_count in ratios.values() for ratio in of_count]
        above = sum(ratio > LIMIT for ratio in everything)
        lines += [
            "",
            f"The largest of these {len(everything)} is {max(everything):.3f}; {above} are above {LIMIT}.",
        ]
        return lines

    def predictions(self) -> list[str]:
        lines = ["| sampler | renderings | inside | median width |", "|---|---|---|---|"]
        plain = {
            (r["scene"], r["sampler"], r["spp"], r["run"]): float(r["mse"])
            for r in self.rows
            if r["method"] == PLAIN
        }
        for sampler in COUNTS:
            inside, widths = 0, []
            for r in self.rows:
                if r["method"] == AUTO and r["sampler"] == sampler:
                    ratio = float(r["mse"]) / plain[r["scene"], sampler, r["spp"], r["run"]]
                    low, high = float(r["predicted_low"]), float(r["predicted_high"])
                    # Where nothing is blended both are 1, but for rounding.
                    inside += low - 1e-5 <= ratio <= high + 1e-5
                    widths.append(high - low)
            width = sorted(widths)[len(widths) // 2]
            lines.append(f"| {sampler} | {len(widths)} | {100 * inside / len(widths):.1f} % | {width:.3f} |")
        return lines


def decile_lines(rows: list[dict[str, str]], ratios: list[float]) -> list[str]:
    """All scenes and samplers together."""
    lines = ["| tenth | " + " | ".join(f"{spp} spp" for spp in ERROR_COUNTS) + " | both |"]
    lines.append("|---" * (len(ERROR_COUNTS) + 2) + "|")
    for decile in range(DECILES):
        known = [(row["spp"], x) for row, x in zip(rows, ratios, strict=True) if int(row["decile"]) == decile]
        columns = [[x for spp, x in known if spp == str(count)] for count in ERROR_COUNTS]
        means = [geometric_mean(column) for column in [*columns, [x for _, x in known]]]
        lines.append(f"| {decile + 1} | " + " | ".join(f"{mean:.2f}" for mean in means) + " |")
    return lines


def error_lines() -> list[str]:
    rows = [row for row in read(ERRORS) if float(row["true"]) > 0]
    ratios = [float(row["estimated"]) / float(row["true"]) for row in rows]
    outside = [i for i, ratio in enumerate(ratios) if not 1 / FACTOR <= ratio <= FACTOR]
    lines = [*decile_lines(rows, ratios), "", "Scene by scene:", ""]
    lines += [f"| sampler | tenths | within a factor of {FACTOR} |", "|---|---|---|"]
    for sampler in COUNTS:
        known = [i for i, row in enumerate(rows) if row["sampler"] == sampler]
        lines.append(f"| {sampler} | {len(known)} | {len(known) - len(set(known) & set(outside))} |")
    if not outside:
        return lines
    lines += ["", "The others:", "", "| scene | sampler | spp | tenth | estimated / true |"]
    lines.append("|---" * 5 + "|")
    for i in outside:
        row = rows[i]
        cells = [f"`{row['scene']}`", row["sampler"], row["spp"], str(int(row["decile"]) + 1)]
        lines.append("| " + " | ".join([*cells, f"{ratios[i]:.2f}"]) + " |")
    return lines


def blocks() -> dict[str, list[str]]:
    measured = Measured()
    tables = {sampler: measured.table(sampler) for sampler in COUNTS}
    return tables | {"predictions": measured.predictions(), "errors": error_lines()}


def main(argv: list[str]) -> int:
    if argv == ["--measure"]:
        measure()
    elif argv not in ([], ["--check"]):
        print(__doc__)
        return 2
    return fill(PAGE, blocks(), __file__, check=argv == ["--check"])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
