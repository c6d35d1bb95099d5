"""The command `guard-tables`: asks `nst` for the tables of all pictures, and stores what training reads."""

import argparse
import tempfile
import time
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from nst_train.binary import run
from nst_train.errors import UserError, exit_code
from nst_train.guard_data import files
from nst_train.guard_data.read import Picture, pictures
from nst_train.guard_training import stored, table
from nst_train.guard_training.stored import LISTS
from nst_train.guard_training.table import Table

FEATURES = ("albedo", "normal", "depth", "emission")
"""What their channels start with."""


def make(folder: Path, names: list[str], say: Callable[[str], None] = print) -> None:
    """All pictures, or those of `names`, which are families or scenes; what is there is kept."""
    failed = []
    for picture in pictures(folder):
        path = stored.path_of(folder, picture)
        if path.is_file() or (names and not {picture.family, picture.scene} & set(names)):
            continue
        began = time.monotonic()
        try:
            make_one(picture, path)
        except (UserError, OSError) as error:
            failed.append(picture.sequence)
            say(f"{picture.sequence}: {error}")
            continue
        say(f"{path}, {time.monotonic() - began:.1f} s")
    if failed:
        raise UserError(f"{len(failed)} pictures failed; the same command tries them again")


def make_one(picture: Picture, path: Path) -> None:
    plain, *halves = (
        np.moveaxis(files.read(each), -1, 0) for each in (picture.sequence, *picture.references)
    )
    with tempfile.TemporaryDirectory() as temporary:
        sequence = picture.sequence
        if lacking := features_left_out(picture):
            sequence = Path(temporary) / "sequence.exr"
            files.without(picture.sequence, sequence, lacking)
        tables = [look(sequence, experts, Path(temporary) / "guard.safetensors") for experts in LISTS]
    stored.write(path, picture, plain, tables, np.stack(halves))


def look(sequence: Path, experts: str, told: Path) -> Table:
    """What `nst` tells of a sequence, which it writes to a file."""
    run("guard-table", sequence, "--experts", experts, "-o", told)
    found = table.read(told)
    if set(found.experts) != set(experts.split(",")):
        raise UserError(f"asked for {experts}, nst tells of {','.join(found.experts)}")
    return found


def features_left_out(picture: Picture) -> tuple[str, ...]:
    """Of a fifth of the pictures that are trained on, all features; of another one, the layer of emission.

    Many renderers do not tell of them. What is left out follows from the names of scene and sequence.
    """
    name = f"{picture.scene}-{picture.sequence.stem}"
    drawn = zlib.crc32(name.encode()) % 5
    if picture.held_out or drawn > 1:
        return ()
    return (FEATURES, ("emission",))[drawn]


def main(argv: list[str]) -> int:
    parser = argparse.ArgumentParser(
        prog="python -m nst_train guard-tables",
        description="What a network that corrects the guard's weights is trained on. "
        "What is there is kept: the same command continues.",
    )
    parser.add_argument(
        "--folder", type=Path, required=True, metavar="DIR", help="that of guard-data; DIR/tables gets tables"
    )
    parser.add_argument("--only", nargs="+", default=[], metavar="NAME", help="families, or scenes")
    arguments = parser.parse_args(argv)

    def work() -> None:
        if not arguments.folder.is_dir():
            raise UserError(f"{arguments.folder}: no such folder; make it with guard-data")
        make(arguments.folder, arguments.only, say=lambda line: print(line, flush=True))

    return exit_code(work)
