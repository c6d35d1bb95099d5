"""Paths per second of `nst` and Mitsuba 3, side by side.

    python3 scenes/generate.py big /tmp/big
    python tests/peers/speed.py --big /tmp/big/big.obj -o speed.csv

Runs of the two alternate, so that what else the machine does hits both. Both take
the same scene, film, samples per pixel, depth and number of threads. `nst` comes from
$NST, or from target/release. README.md says what each time covers.
"""

import argparse
import csv
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from mitsuba_scene import translate
from scene_files import read_scene

REPOSITORY = Path(__file__).resolve().parents[2]
SIZE = (256, 256)
SPP = 32


@dataclass(frozen=True)
class Run:
    """A row of the table."""

    scene: str
    renderer: str
    version: str
    threads: int
    run: int
    seconds: float
    """From the scene, ready to be traced, to the picture."""
    paths_per_second: float
    build_seconds: float
    """To make it ready: in each run of `nst`, once before Mitsuba's first."""


class Nst:
    """A process for each run."""

    name = "nst"
    build_seconds = 0.0

    def __init__(self, scene: Path, threads: int) -> None:
        self.program = os.environ.get("NST", REPOSITORY / "target/release/nst")
        self.scene, self.threads = scene, threads
        version = subprocess.run([self.program, "--version"], capture_output=True, check=True)
        self.version = version.stdout.decode().split()[-1]

    def seconds(self, seed: int) -> float:
        """Renders; returns the time that `nst` measured, but for its acceleration structure."""
        with tempfile.TemporaryDirectory() as folder:
            command: list[Any] = [self.program, "render", "--scene", self.scene]
            command += ["--size", f"{SIZE[0]}x{SIZE[1]}", "--spp", SPP, "--seed", seed]
            command += ["--transform", "none", "--threads", self.threads, "--json"]
            command += ["-o", Path(folder, "picture.exr")]
            done = subprocess.run([str(x) for x in command], stdout=subprocess.PIPE, check=True)
        summary = json.loads(done.stdout)
        self.build_seconds = summary["build_seconds"]
        return summary["render_seconds"] - self.build_seconds


class Mitsuba:
    """In this process: the scene is loaded, and its kernels compiled, once."""

    name = "mitsuba"
    version = mi.__version__

    def __init__(self, scene: Path, threads: int) -> None:
        dr.set_thread_count(threads)
        files = read_scene(scene)
        start = time.perf_counter()
        self.scene = mi.load_dict(translate(files, SIZE))
        dr.sync_thread()
        self.build_seconds = time.perf_counter() - start + self.seconds(seed=0)

    def seconds(self, seed: int) -> float:
        """Renders; returns the time up to the picture as an array."""
        start = time.perf_counter()
        picture = np.array(mi.render(self.scene, spp=SPP, seed=seed))
        seconds = time.perf_counter() - start
        assert picture.shape == (SIZE[1], SIZE[0], 3) and np.isfinite(picture).all()
        return seconds


def measure(scene: Path, threads: int, runs: int) -> Iterator[Run]:
    """Warms both up, then lets them take turns."""
    renderers = [Nst(scene, threads), Mitsuba(scene, threads)]
    for renderer in renderers:
        renderer.seconds(seed=0)
    for run in range(1, runs + 1):
        for renderer in renderers:
            seconds = renderer.seconds(seed=run)
            yield Run(
                scene=scene.stem,
                renderer=renderer.name,
                version=renderer.version,
                threads=threads,
                run=run,
                seconds=seconds,
                paths_per_second=SIZE[0] * SIZE[1] * SPP / seconds,
                build_seconds=renderer.build_seconds,
            )


def print_medians(rows: list[Run]) -> None:
    print("million paths per second, medians")
    for scene in dict.fromkeys(row.scene for row in rows):
        ours, theirs = (
            statistics.median(
                row.paths_per_second for row in rows if (row.scene, row.renderer) == (scene, renderer.name)
            )
            for renderer in (Nst, Mitsuba)
        )
        rates = f"nst {ours / 1e6:.3f}, mitsuba {theirs / 1e6:.3f}"
        whole = statistics.median(
            SIZE[0] * SIZE[1] * SPP / (row.seconds + row.build_seconds)
            for row in rows
            if (row.scene, row.renderer) == (scene, Nst.name)
        )
        print(
            f"{scene}: {rates}, ratio {ours / theirs:.2f}; "
            f"with its building nst {whole / 1e6:.3f}, ratio {whole / theirs:.2f}"
        )


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Compare the speed of nst and Mitsuba 3.")
    parser.add_argument("--big", type=Path, metavar="OBJ", help="a second scene to render")
    parser.add_argument("--runs", type=int, default=5, help="timed renders of each (default: 5)")
    parser.add_argument("--threads", type=int, default=os.cpu_count(), help="default: all")
    parser.add_argument("--variant", default="llvm_ad_rgb", help="of Mitsuba")
    parser.add_argument("-o", "--output", type=Path, metavar="CSV", help="file to write")
    args = parser.parse_args()
    if args.runs < 1 or args.threads < 1:
        parser.error("--runs and --threads: at least 1")
    return args


def main() -> None:
    args = arguments()
    mi.set_variant(args.variant)
    scenes = [REPOSITORY / "scenes/cornell/cornell.obj"]
    if args.big:
        scenes.append(args.big)
    rows = []
    for scene in scenes:
        for row in measure(scene, args.threads, args.runs):
            rows.append(row)
            what = f"{row.scene}, run {row.run}: {row.renderer}"
            print(f"{what} {row.seconds:.3f} s", file=sys.stderr)
    print_medians(rows)
    if args.output:
        with args.output.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(field.name for field in fields(Run))
            writer.writerows(map(astuple, rows))


if __name__ == "__main__":
    main()
