"""Errors of T, for any weights of the experts.

Errors are means of (T − R₁)(T − R₂) over pixels and channels, without the noise of the references on average:
MSE, and relMSE, each square divided by R² + 0.01 with R the mean of both. With weights w of a pixel, and
d = changes,

    (T − R₁)(T − R₂) = (rest − R₁)(rest − R₂) + Σ_ij w_i w_j d_i d_j − 2 Σ_i w_i d_i (R − rest)

so that what a row's weights change is wᵀAw − 2gw, if its pixels are those of its cell, each by its share of
the two knots beside its brightness. Between cells, weights are taken as constant, and of the two knots each
counts by itself, which is never less than what the mean of their weights does. `interpolate` is exact.
"""

import numpy as np

from nst_train.guard_training.table import EXPERTS, Table

METRICS = ("MSE", "relMSE")
RELATIVE_FLOOR = 0.01
PAIRS = [(i, j) for i in range(len(EXPERTS)) for j in range(i + 1)]
"""The order of A in a form: 00, 10, 11, 20, 21, 22; g comes after it."""
FORM = len(PAIRS) + len(EXPERTS)


def importance(halves: np.ndarray) -> np.ndarray:
    """What squares are multiplied by, `[metric, …]`."""
    mean = halves.mean(axis=0)
    return np.stack([np.ones_like(mean), 1.0 / (mean * mean + RELATIVE_FLOOR)])


def errors(picture: np.ndarray, halves: np.ndarray) -> np.ndarray:
    """`[metric]` of a picture `[…]`; halves are `[half, …]`."""
    squares = (picture - halves[0]) * (picture - halves[1])
    return (importance(halves) * squares).reshape(len(METRICS), -1).mean(axis=1)


def noise(halves: np.ndarray) -> np.ndarray:
    """`[metric]`: the variance of the mean of both halves."""
    squares = (halves[0] - halves[1]) ** 2 / 4
    return (importance(halves) * squares).reshape(len(METRICS), -1).mean(axis=1)


def knots_of(table: Table) -> tuple[np.ndarray, np.ndarray]:
    """The knot below each pixel, `[y, x]`, and the share of the next one."""
    below = np.minimum(table.places.astype(np.int64), table.grid[2] - 2)
    return below, table.places - below


def forms(table: Table, halves: np.ndarray) -> np.ndarray:
    """`[cell's row, cell's column, knot, metric, FORM]` of a table and references `[half, channel, y, x]`.

    Experts that the table does not have change nothing.
    """
    rows, columns, knots = table.grid
    changes = np.zeros((len(EXPERTS), *table.rest.shape))
    changes[table.slots] = table.changes
    lacking = halves.mean(axis=0) - table.rest
    below, share = knots_of(table)
    y, x = np.indices(below.shape)
    row = (y // table.cell * columns + x // table.cell) * knots + below
    where = np.concatenate([row.ravel(), row.ravel() + 1])
    found = np.empty((len(METRICS), FORM, rows * columns * knots))
    for metric, weight in enumerate(importance(halves) / table.rest.size):
        terms = [weight * changes[i] * changes[j] for i, j in PAIRS]
        terms += [weight * change * lacking for change in changes]
        for k, term in enumerate(terms):
            pixels = term.sum(axis=0)
            shared = np.concatenate([((1 - share) * pixels).ravel(), (share * pixels).ravel()])
            found[metric, k] = np.bincount(where, shared, rows * columns * knots)
    return np.moveaxis(found, -1, 0).reshape(rows, columns, knots, len(METRICS), FORM)


def between(pixels: int, cells: int, size: int) -> np.ndarray:
    """`[pixel, cell]`: the share of each cell, linear between the centres of two, constant outside."""
    at = np.clip((np.arange(pixels) + 0.5) / size - 0.5, 0, cells - 1)
    first = np.minimum(at.astype(np.int64), max(cells - 2, 0))
    shares = np.zeros((pixels, cells))
    np.add.at(shares, (np.arange(pixels), first), 1 - (at - first))
    np.add.at(shares, (np.arange(pixels), np.minimum(first + 1, cells - 1)), at - first)
    return shares


def reached(table: Table) -> np.ndarray:
    """`[row, column, knot]`: whether a pixel in that cell, or in one beside it, has that knot."""
    rows, columns, knots = table.grid
    below, share = knots_of(table)
    y, x = np.indices(below.shape)
    own = np.zeros((rows, columns, knots), bool)
    own[y // table.cell, x // table.cell, below] = True
    at, to = np.nonzero(share)
    own[at // table.cell, to // table.cell, below[at, to] + 1] = True
    padded = np.pad(own, ((1, 1), (1, 1), (0, 0)))
    return np.any([padded[i : i + rows, j : j + columns] for i in range(3) for j in range(3)], axis=0)


def interpolate(weights: np.ndarray, table: Table) -> np.ndarray:
    """Weights `[cell's row, cell's column, knot, expert]` to those of pixels, `[expert, y, x]`."""
    below, share = knots_of(table)
    height, width = below.shape
    down = between(height, table.grid[0], table.cell)
    across = between(width, table.grid[1], table.cell)
    y, x = np.indices(below.shape)
    smooth = np.einsum("yr,xc,rcke->yxke", down, across, weights, optimize=True)
    mixed = (1 - share)[..., None] * smooth[y, x, below] + share[..., None] * smooth[y, x, below + 1]
    return np.moveaxis(mixed, -1, 0)


def blended(weights: np.ndarray, table: Table) -> np.ndarray:
    """T `[channel, y, x]` for weights `[cell's row, cell's column, knot, expert]` of the table's experts."""
    return table.rest + np.einsum("eyx,ecyx->cyx", interpolate(weights, table), table.changes)
