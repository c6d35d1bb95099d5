"""Writes random scenes: see the package."""

import argparse
from pathlib import Path

from nst_train.random_scenes import BRANCHES, random_scene, write

if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m nst_train.random_scenes", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--branches", nargs="+", choices=BRANCHES, default=list(BRANCHES), metavar="NAME")
    parser.add_argument("--scenes", type=int, default=5, help="of each branch [default: 5]")
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    for branch in arguments.branches:
        for index in range(arguments.scenes):
            print(write(random_scene(branch, index, arguments.seed), arguments.folder))
