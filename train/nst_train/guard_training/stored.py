"""What is stored of a picture for training, a compressed file: `DIR/tables/training/SCENE-SPP-RUN.npz`, or
`DIR/tables/held-out/…` of families that are held out."""

import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from nst_train.errors import UserError
from nst_train.guard_data.read import Picture
from nst_train.guard_training import forms
from nst_train.guard_training.forms import FORM, METRICS
from nst_train.guard_training.table import EXPERTS, INPUTS, Table

FORMAT = "nst-guard-forms-1"
LISTS = ("lane,filter", "lane,filter,oidn")
"""Lists of experts that each picture is looked at with."""
OF_PIXELS = ("places", "changes", "rest")


@dataclass(frozen=True)
class Rows:
    """A picture with one list of experts; those of `EXPERTS` that are not in it have zeros."""

    experts: str
    where: np.ndarray  # [row, 3]: cell's row, cell's column, knot
    inputs: np.ndarray  # [row, half, input]
    closed: np.ndarray  # [row, half, expert]
    forms: np.ndarray  # [row, metric, FORM]
    constant: np.ndarray  # [metric]: the errors where all weights are 0
    closed_errors: np.ndarray  # [metric], those of the closed form


@dataclass(frozen=True)
class Stored:
    """A picture: errors, `[metric]` each, and what each list of experts makes of it."""

    scene: str
    family: str
    spp: int
    plain: np.ndarray  # errors of S
    denoiser: np.ndarray  # of S and all that the denoiser changes in what surfaces reflect
    noise: np.ndarray  # of the mean of both references
    lists: list[Rows]


def path_of(folder: Path, picture: Picture) -> Path:
    return folder_of(folder, picture.held_out) / f"{picture.scene}-{picture.sequence.stem}.npz"


def folder_of(folder: Path, held_out: bool) -> Path:
    return folder / "tables" / ("held-out" if held_out else "training")


def files(folder: Path, held_out: bool) -> list[Path]:
    """All that are complete."""
    found = sorted(folder_of(folder, held_out).glob("[!.]*.npz"))
    if not found:
        raise UserError(
            f"{folder_of(folder, held_out)}: no tables; make them with "
            f"`python -m nst_train guard-tables --folder {folder}`"
        )
    return found


def write(path: Path, picture: Picture, plain: np.ndarray, tables: list[Table], halves: np.ndarray) -> None:
    """Writes the tables of a picture S `[channel, y, x]`, one for each of `LISTS`, with what is true,
    `[half, channel, y, x]`. Of held-out pictures, pixels are stored, too, for exact errors."""
    stored = {
        "format": FORMAT,
        "scene": picture.scene,
        "family": picture.family,
        "spp": picture.spp,
        "plain": forms.errors(plain, halves),
        "denoiser": forms.errors(plain + _denoised(tables), halves),
        "noise": forms.noise(halves),
    }
    for experts, table in zip(LISTS, tables, strict=True):
        of_list = _rows(table, halves)
        if picture.held_out:
            of_list |= {"names": table.experts, "cell": table.cell, "grid": table.grid}
            of_list |= {name: getattr(table, name) for name in OF_PIXELS}
        stored |= {f"{experts} {name}": value for name, value in of_list.items()}
    if picture.held_out:
        stored["halves"] = halves.astype(np.float32)
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(f".unfinished-{path.name}")
    np.savez_compressed(unfinished, **stored)
    unfinished.replace(path)


def _denoised(tables: list[Table]) -> np.ndarray:
    for table in tables:
        if "oidn" in table.experts:
            return table.changes[table.experts.index("oidn")]
    raise UserError("no table says what the denoiser changes")


def _rows(table: Table, halves: np.ndarray) -> dict[str, np.ndarray]:
    where = np.nonzero(forms.reached(table))
    closed = np.zeros((len(where[0]), 2, len(EXPERTS)), np.float32)
    closed[..., table.slots] = table.closed[where]
    of_closed = forms.blended(table.closed.mean(axis=3, dtype=np.float64), table)
    return {
        "where": np.stack(where, axis=1).astype(np.uint16),
        "inputs": table.inputs[where],
        "closed": closed,
        "forms": forms.forms(table, halves)[where].astype(np.float32),
        "constant": forms.errors(table.rest, halves),
        "closed_errors": forms.errors(of_closed, halves),
    }


def read(path: Path) -> Stored:
    with _opened(path) as file:
        return _read(file)


def read_with_pixels(path: Path) -> tuple[Stored, list[Table], np.ndarray]:
    """A held-out picture; its tables, whose inputs and closed form are in the rows alone; and its references
    `[half, channel, y, x]`."""
    with _opened(path) as file:
        tables = [_read_pixels(experts, file) for experts in LISTS]
        return _read(file), tables, file["halves"].astype(np.float64)


@contextmanager
def _opened(path: Path) -> Iterator[np.lib.npyio.NpzFile]:
    try:
        with np.load(path) as file:
            if str(file["format"]) != FORMAT:
                raise UserError(f"{path}: format is {str(file['format'])!r}, expected {FORMAT!r}")
            yield file
    except (KeyError, TypeError, ValueError, EOFError, OSError, zipfile.BadZipFile, zlib.error) as error:
        raise UserError(f"{path}: damaged, or not a table: {error}; delete it, and make it again") from error


def _read(file: np.lib.npyio.NpzFile) -> Stored:
    lists = [_read_rows(experts, file) for experts in LISTS]
    errors = [_shaped(file, name, (len(METRICS),)) for name in ("plain", "denoiser", "noise")]
    return Stored(str(file["scene"]), str(file["family"]), int(file["spp"]), *errors, lists)


def _read_rows(experts: str, file: np.lib.npyio.NpzFile) -> Rows:
    rows = len(file[f"{experts} where"])
    shapes = {
        "where": (rows, 3),
        "inputs": (rows, 2, INPUTS),
        "closed": (rows, 2, len(EXPERTS)),
        "forms": (rows, len(METRICS), FORM),
        "constant": (len(METRICS),),
        "closed_errors": (len(METRICS),),
    }
    return Rows(
        experts, **{name: _shaped(file, f"{experts} {name}", shape) for name, shape in shapes.items()}
    )


def _shaped(file: np.lib.npyio.NpzFile, name: str, shape: tuple[int, ...]) -> np.ndarray:
    array = file[name]
    if array.shape != shape:
        raise ValueError(f"{name} has the shape {list(array.shape)}, expected {list(shape)}")
    if not np.isfinite(array).all():
        raise ValueError(f"a number of {name} is NaN or infinite")
    return array


def _read_pixels(experts: str, file: np.lib.npyio.NpzFile) -> Table:
    names = tuple(str(name) for name in file[f"{experts} names"])
    grid = tuple(int(n) for n in file[f"{experts} grid"])
    empty = np.empty((*grid, 2, 0), np.float32)
    pixels = {name: file[f"{experts} {name}"] for name in OF_PIXELS}
    return Table(names, int(file[f"{experts} cell"]), inputs=empty, closed=empty, **pixels)
