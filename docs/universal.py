"""Measures what a network that was trained over many scenes adds to `--experts lane`: for
docs/adaptation.md.

    python docs/universal.py            # writes the table into the page
    python docs/universal.py --check    # compares instead; exit code 1 on a difference
    python docs/universal.py --measure  # the CSV, first

`--measure` uses target/release/nst, or the binary that the environment variable NST names, and goes on where
it was cut off. docs/universal.csv has a row for each rendering and method: errors against a reference of two
independent halves.
"""

import csv
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from statistics import fmean, geometric_mean

from adaptation import (
    PAGE,
    REFERENCE_SPP,
    ROOT,
    SCENES,
    SIZE,
    USUAL_REFERENCE_SPP,
    append,
    read,
    rounded,
    scene_file,
)
from page import fill

NST = os.environ.get("NST", str(ROOT / "target" / "release" / "nst"))
TABLE = ROOT / "docs" / "universal.csv"
COLUMNS = ["scene", "method", "spp", "run", "mse", "relmse"]
COUNTS = [8, 32, 256]
RUNS = 4
PLAIN, AUTO, NETWORK = "none", "auto: lane", "small"
BLENDED = f"{AUTO} + {NETWORK}"
NAMES = {
    AUTO: "`auto --experts lane`",
    BLENDED: f"`auto --experts lane,{NETWORK}`",
    NETWORK: f"`{NETWORK}` alone",
}


def bench(scene: str, folder: Path) -> list[list[object]]:
    table = folder / f"{scene}.csv"
    command = [NST, "bench", "scene", "--scene", scene_file(scene), "--size", SIZE, *SCENES[scene][0]]
    command += ["--spp", *map(str, COUNTS), "--runs", str(RUNS)]
    reference_spp = str(REFERENCE_SPP.get(scene, USUAL_REFERENCE_SPP))
    command += ["--reference-spp", reference_spp, "--backend", "cpu", "--quiet", "-o", str(table)]
    for options in (
        ["--transform", f"auto,{NETWORK}", "--experts", "lane"],
        ["--transform", "auto", "--experts", f"lane,{NETWORK}"],
    ):
        subprocess.run([*command, *options], check=True, stdout=subprocess.DEVNULL)
    return [
        [scene, *(row[name] for name in COLUMNS[1:4]), *(rounded(row[name]) for name in COLUMNS[4:])]
        for row in read(table)
    ]


def measure() -> None:
    done = {row["scene"] for row in read(TABLE)} if TABLE.is_file() else set()
    with tempfile.TemporaryDirectory() as name:
        for scene in SCENES:
            if scene not in done:
                append(TABLE, COLUMNS, bench(scene, Path(name)))
                print(scene, file=sys.stderr)


def ratios(rows: list[dict[str, str]], scene: str, method: str, spp: int) -> list[float]:
    """MSE ratio and relMSE ratio to S, of means over the runs."""

    def mean(method: str, error: str) -> float:
        wanted = (scene, method, str(spp))
        return fmean(float(row[error]) for row in rows if (row["scene"], row["method"], row["spp"]) == wanted)

    return [mean(method, error) / mean(PLAIN, error) for error in ("mse", "relmse")]


def table(rows: list[dict[str, str]]) -> list[str]:
    lines = ["| scene | method | " + " | ".join(f"{spp} spp" for spp in COUNTS) + " |"]
    lines.append("|---" * (2 + len(COUNTS)) + "|")
    scenes = [scene for scene in SCENES if any(row["scene"] == scene for row in rows)]

    def line(scene: str, method: str, cells: list[list[float]]) -> str:
        texts = (" / ".join(f"{ratio:.3f}" for ratio in cell) for cell in cells)
        return f"| {scene} | {NAMES[method]} | " + " | ".join(texts) + " |"

    for scene in scenes:
        lines.extend(
            line(f"`{scene}`", method, [ratios(rows, scene, method, spp) for spp in COUNTS])
            for method in NAMES
        )
    for method in NAMES:
        means = []
        for spp in COUNTS:
            of_scenes = [ratios(rows, scene, method, spp) for scene in scenes]
            means.append([geometric_mean(column) for column in zip(*of_scenes, strict=True)])
        lines.append(line("geometric mean", method, means))
    return lines


def main() -> int:
    if "--measure" in sys.argv:
        measure()
        return 0
    return fill(PAGE, {"universal": table(read(TABLE))}, __file__, check="--check" in sys.argv)


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (OSError, KeyError, ValueError, csv.Error) as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(1)
