"""The held-out 1D integrands as a table, which `nst bench stability` reads: one definition for both.

    python -m nst_train.held_out            # rewrites crates/nst-cli/…/bench/stability/integrands.csv
    python -m nst_train.held_out --check    # compares instead; exit code 1 on a difference

One row per integrand h · N(x; μ, σ) · 1[x < t], in the order of `families.integrands`. A step is
h · 1[x < t]: its μ and σ are empty. `integral` is I, and `values` are f at `POINTS`: with them, the
Rust side checks its own formulas.
"""

import argparse
import csv
import io
import math
import sys
from pathlib import Path

import numpy as np

from nst_train.errors import UserError
from nst_train.families import FAMILIES, TEST_GRID, GaussianStep, Integrand, Step, integrands
from nst_train.renders import REPOSITORY

TABLE = REPOSITORY / "crates/nst-cli/src/commands/bench/stability/integrands.csv"
PARAMETERS = ["mean", "deviation", "edge", "height"]
COLUMNS = ["family", *PARAMETERS, "integral", "values"]

POINTS = (np.arange(16) + 0.5) / 16
"""Midpoints of 16 equal cells: some on both sides of every edge."""

TOLERANCE = 1e-14
"""Relative, of integrals and values: other versions of exp and erf may differ in the last bits."""


def parameters(function: Integrand) -> list[float | None]:
    """In the order of `PARAMETERS`."""
    match function:
        case GaussianStep(mu, sigma, t):
            return [mu, sigma, t, 1.0]
        case Step(t, h):
            return [None, None, t, h]
    raise ValueError(f"not an integrand of a family: {function!r}")


def table() -> str:
    """The file's text. Numbers have all digits: what is read back is the same f64."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for family in FAMILIES:
        for function in integrands(family, TEST_GRID):
            numbers = ["" if x is None else repr(float(x)) for x in parameters(function)]
            values = " ".join(repr(float(y)) for y in function(POINTS))
            writer.writerow([family, *numbers, repr(function.integral()), values])
    return text.getvalue()


def differences(stored: str, computed: str) -> list[str]:
    """Cells that differ, integrals and values by more than `TOLERANCE`."""
    old, new = (list(csv.DictReader(io.StringIO(text))) for text in (stored, computed))
    if not stored.startswith(",".join(COLUMNS) + "\n") or len(old) != len(new):
        return [f"expected {len(new)} rows of {','.join(COLUMNS)}"]
    found = []
    for number, (a, b) in enumerate(zip(old, new, strict=True), start=2):
        for column in COLUMNS:
            computed_cell = column in ("integral", "values")
            if a[column] != b[column] and not (computed_cell and close(a[column], b[column])):
                found.append(f"line {number}, {column}: {a[column]}, not {b[column]}")
    return found


def close(a: str, b: str) -> bool:
    """Whether two cells contain the same numbers, but for rounding."""
    try:
        pairs = list(zip(map(float, a.split()), map(float, b.split()), strict=True))
    except ValueError:
        return False
    return all(math.isclose(x, y, rel_tol=TOLERANCE) for x, y in pairs)


def main(argv: list[str] | None = None) -> int:
    """`argv` is for tests; without it, the command line. Returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m nst_train.held_out", description=__doc__)
    parser.add_argument("--check", action="store_true", help="compare instead of writing")
    parser.add_argument("--table", type=Path, default=TABLE, help="[default: the one of nst-cli]")
    a = parser.parse_args(argv)
    try:
        if not a.check:
            a.table.write_text(table(), encoding="utf-8")
        elif found := differences(a.table.read_text(encoding="utf-8"), table()):
            raise UserError(f"{a.table}: {found[0]}; run nst_train.held_out")
    except (UserError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
