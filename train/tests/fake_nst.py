"""Takes the arguments of `nst render`, and "renders" noise around x + 1 at pixel (x, y).

Row 0 has no noise; seed 13 fails. Each call adds a line to the file that FAKE_NST_LOG names.
"""

import argparse
import os
import sys
from pathlib import Path

import numpy as np
from sequence_writer import write_sequence

SCENE = "cornell:0123456789abcdef"
DEVIATION = 0.1

if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("command", choices=["render"])
    parser.add_argument("--scene", required=True, type=Path)
    parser.add_argument("--spp", required=True, type=int)
    parser.add_argument("--size", required=True)
    parser.add_argument("--seed", required=True, type=int)
    parser.add_argument("--keep", required=True, choices=["all", "window"])
    parser.add_argument("--transform", required=True, choices=["none"])
    parser.add_argument("--sequence", required=True, type=Path)
    parser.add_argument("-o", required=True, type=Path)
    parser.add_argument("--quiet", action="store_true", required=True)
    a = parser.parse_args()
    if a.seed == 13:
        sys.exit("error: the scene is on fire\nput it out")
    assert a.scene.is_file()

    width, height = map(int, a.size.split("x"))
    noise = np.random.default_rng(a.seed).normal(0.0, DEVIATION, (a.spp, height, width, 3))
    noise[:, 0] = 0.0
    samples = np.arange(1.0, width + 1)[:, None] + noise
    means = np.cumsum(samples, axis=0) / np.arange(1, a.spp + 1)[:, None, None, None]
    first = 1 if a.keep == "all" else a.spp - 7
    layers = {f"S{k:04}.": means[k - 1] for k in range(first, a.spp + 1)} | {"": means[-1]}
    layers = {name: pixels.astype(np.float32) for name, pixels in layers.items()}
    write_sequence(a.sequence, layers, scene=SCENE)
    a.o.write_text("an image")
    with open(os.environ["FAKE_NST_LOG"], "a", encoding="utf-8") as log:
        print(a.keep, a.seed, a.spp, file=log)
