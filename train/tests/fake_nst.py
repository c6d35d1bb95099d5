"""Takes the arguments of `nst render --runs`, and "renders" noise around x + 1 at pixel (x, y).

Row 0 has no noise; seed 13 fails. FAKE_NST_GREY makes the three channels equal. Each call adds a line to
the file that FAKE_NST_LOG names.
"""

import argparse
import os
import sys
from pathlib import Path

import numpy as np

from dataset_writer import write_dataset

SCENE = "box:v2:0123456789abcdef"
DEVIATION = 0.1

if __name__ == "__main__":
    if sys.argv[1:] == ["--version"]:
        sys.exit(print("nst 9.9.9"))
    parser = argparse.ArgumentParser()
    parser.add_argument("command", choices=["render"])
    parser.add_argument("--scene", required=True, type=Path)
    parser.add_argument("--runs", required=True, type=int)
    parser.add_argument("--spp", required=True, type=int)
    parser.add_argument("--size", required=True)
    parser.add_argument("--seed", required=True, type=int)
    parser.add_argument("--sampler", required=True, choices=["random", "halton"])
    parser.add_argument("--max-depth", default=8, type=int)
    parser.add_argument("--pixel", required=True, choices=["box", "center"])
    parser.add_argument("--keep", default="all", choices=["all", "window"])
    parser.add_argument("-o", required=True, type=Path)
    parser.add_argument("--quiet", action="store_true", required=True)
    a = parser.parse_args()
    if a.seed == 13:
        sys.exit("error: the scene is on fire\nput it out")
    assert a.scene.is_file()

    width, height = map(int, a.size.split("x"))
    channels = 1 if os.environ.get("FAKE_NST_GREY") else 3
    rng = np.random.default_rng(a.seed)
    noise = rng.normal(0.0, DEVIATION, (a.runs, a.spp, channels, height, width))
    noise[:, :, :, 0] = 0.0
    samples = np.broadcast_to(np.arange(1.0, width + 1) + noise, (a.runs, a.spp, 3, height, width))
    means = np.cumsum(samples, axis=1) / np.arange(1, a.spp + 1)[:, None, None, None]
    first = 1 if a.keep == "all" else max(1, a.spp - 7)
    kept = np.ascontiguousarray(means[:, first - 1 :].reshape(a.runs, a.spp - first + 1, -1))
    counts = ",".join(map(str, range(first, a.spp + 1)))
    write_dataset(
        a.o,
        kept.astype(np.float32),
        (width, height),
        scene=SCENE,
        sampler=a.sampler,
        sample_counts=counts,
    )
    with open(os.environ["FAKE_NST_LOG"], "a", encoding="utf-8") as log:
        print(a.keep, a.seed, a.runs, a.spp, a.sampler, a.max_depth, a.pixel, file=log)
