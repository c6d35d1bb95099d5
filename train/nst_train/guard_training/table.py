"""What `nst guard-table` says of a picture: what the network reads, and what is weighed."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import safetensors

from nst_train.errors import UserError

FORMAT = "nst-guard-table-1"
EXPERTS = ("lane", "filter", "oidn")
"""All that the network knows, in the order of its outputs."""
INPUTS = 18
"""Numbers that the network reads for each row."""


@dataclass(frozen=True)
class Table:
    """A *row* is a cell of the picture and a knot of brightness.

    T = rest + Σ_e w_e(y, x) changes_e, with weights that are linear between the centres of cells and between
    knots. They are the means of two, each learnt from a half of a chessboard.
    """

    experts: tuple[str, ...]
    cell: int  # width and height in pixels
    inputs: np.ndarray  # [cell's row, cell's column, knot, half, input]
    closed: np.ndarray  # [cell's row, cell's column, knot, half, expert], the closed form's weights
    places: np.ndarray  # [y, x], brightness in knots
    changes: np.ndarray  # [expert, channel, y, x]
    rest: np.ndarray  # [channel, y, x]

    @property
    def grid(self) -> tuple[int, int, int]:
        """Rows and columns of cells, and knots."""
        return self.closed.shape[:3]

    @property
    def slots(self) -> list[int]:
        """Where its experts are among `EXPERTS`."""
        return [EXPERTS.index(name) for name in self.experts]


def read(path: Path) -> Table:
    """Reads and checks a file."""
    if not path.is_file():
        raise UserError(f"{path}: no such file")
    try:
        with safetensors.safe_open(path, framework="np") as file:
            told = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 (no dictionary)
    except safetensors.SafetensorError as error:
        raise UserError(f"{path}: not a safetensors file: {error}") from error
    if told.get("format") != FORMAT:
        raise UserError(f"{path}: format is {told.get('format')!r}, expected {FORMAT!r}")
    try:
        table = Table(tuple(told["experts"].split(",")), int(told["cell"]), **tensors)
        mistake = _mistake(table)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise UserError(f"{path}: not what a table of the guard contains: {error}") from error
    if mistake:
        raise UserError(f"{path}: {mistake}")
    return table


def _mistake(table: Table) -> str | None:
    """What is wrong with it."""
    if not set(table.experts) <= set(EXPERTS) or len(set(table.experts)) != len(table.experts):
        return f"experts = {','.join(table.experts)}: expected some of {','.join(EXPERTS)}"
    channels, height, width = table.rest.shape
    if table.cell < 1:
        return f"cell = {table.cell}: must be 1 or more"
    cells = (-(-height // table.cell), -(-width // table.cell))
    knots, experts = table.closed.shape[2], len(table.experts)
    if knots < 2:
        return f"{knots} knots: must be 2 or more"
    expected = {
        "inputs": (*cells, knots, 2, INPUTS),
        "closed": (*cells, knots, 2, experts),
        "places": (height, width),
        "changes": (experts, channels, height, width),
    }
    for name, shape in expected.items():
        found = getattr(table, name).shape
        if found != shape:
            return f"{name} has the shape {list(found)}, expected {list(shape)}"
    for name in (*expected, "rest"):
        if not np.isfinite(getattr(table, name)).all():
            return f"a number of {name} is NaN or infinite"
    if table.places.min() < 0 or table.places.max() > knots - 1:
        return f"a place is not within the {knots} knots"
    return None
