"""Weights of the guard's experts that know the reference, for docs/neighbours_oracle.py.

What weights change in the errors of T is a quadratic form, summed over pixels: wᵀA w − 2 bᵀw with A = Σ d dᵀ
and b = Σ d (R − rest), where d is what each expert changes. Weights are for each *row*, a cell of the picture
at a knot of brightness, on the simplex w ≥ 0, Σw ≤ 1, and linear between the centres of cells and between
knots.
"""

import sys
from dataclasses import dataclass
from itertools import chain, combinations
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).resolve().parent.parent / "train"))
from nst_train.guard_training import forms
from nst_train.guard_training.table import EXPERTS, Table

# As crates/nst-core/src/guard/picture has them: distances in pixels, brightness in knots.
DISTANCE, BRIGHTNESS, REACH = 8.0, 0.7, 3.0
RIDGE = 1e-4
# Of the least error, up to which the best weights are found; and how many steps it may take.
PRECISION = 1e-4
STEPS = 4000
STEPS_BETWEEN_CHECKS = 20


class Simplex:
    """The weights w ≥ 0, Σw ≤ 1 with the least wᵀA w − 2 bᵀw, for each of many A `[row, expert, expert]`.

    All sets of experts that may have a weight are tried, with Σw free and with Σw = 1.
    """

    def __init__(self, a: np.ndarray) -> None:
        count = a.shape[-1]
        trace = np.trace(a, axis1=1, axis2=2)
        # Experts that agree share a weight; what nothing is known of gets any A, as b is 0.
        ridge = np.where(trace > 0, RIDGE * trace / count, 1.0)
        self.a = a + ridge[:, None, None] * np.eye(count)
        self.sets = []
        sizes = (combinations(range(count), size) for size in range(1, count + 1))
        for members in map(list, chain.from_iterable(sizes)):
            inverse = np.linalg.inv(self.a[:, members][:, :, members])
            along = inverse.sum(axis=2)
            self.sets.append((members, inverse, along / along.sum(axis=1, keepdims=True)))

    def best(self, b: np.ndarray) -> np.ndarray:
        """`[row, expert]` for b `[row, expert]`."""
        found, least = np.zeros_like(b), np.zeros(len(b))
        for members, inverse, along in self.sets:
            free = np.einsum("rij,rj->ri", inverse, b[:, members])
            w = np.zeros_like(b)
            w[:, members] = free - np.maximum(free.sum(axis=1, keepdims=True) - 1, 0) * along
            change = np.einsum("ri,rij,rj->r", w, self.a, w) - 2 * (b * w).sum(axis=1)
            better = (w >= 0).all(axis=1) & (change < least)
            found[better], least[better] = w[better], change[better]
        return found


def gaussian(sigma: float) -> np.ndarray:
    reach = int(np.ceil(REACH * sigma))
    shares = np.exp(-0.5 * (np.arange(-reach, reach + 1) / sigma) ** 2)
    return shares / shares.sum()


def smoothed(sums: np.ndarray, axis: int, sigma: float, mode: str) -> np.ndarray:
    """What is beyond the ends counts as at them (`edge`), or as nothing (`constant`)."""
    kernel = gaussian(sigma)
    reach, size = len(kernel) // 2, sums.shape[axis]
    padded = np.pad(sums, [(reach, reach) if i == axis else (0, 0) for i in range(sums.ndim)], mode)
    parts = np.moveaxis(padded, axis, 0)
    total = sum(share * parts[i : i + size] for i, share in enumerate(kernel))
    return np.moveaxis(total, 0, axis)


def by_sums(table: Table, halves: np.ndarray, metric: int) -> dict[str, np.ndarray]:
    """The guard's weights, if b said what is true: from sums `near` a cell, and of each `cell` alone; where
    that has none, as near. `[cell's row, cell's column, knot, expert]`."""
    own = forms.forms(table, halves)[..., metric, :]
    own = smoothed(own, 2, BRIGHTNESS, "constant")
    near = own
    for axis in (0, 1):
        near = smoothed(near, axis, DISTANCE / table.cell, "edge")
    grid, count = table.grid, len(table.experts)
    found = {}
    for name, sums in {"near": near, "cell": own}.items():
        a, b = of_forms(sums.reshape(-1, forms.FORM), table.slots)
        found[name] = Simplex(a).best(b).reshape(*grid, count)
        if name == "cell":
            known = (np.trace(a, axis1=1, axis2=2) > 0).reshape(grid)
            found[name] = np.where(known[..., None], found[name], found["near"])
    return found


def of_forms(sums: np.ndarray, slots: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """A and b of these experts, of forms `[row, FORM]`."""
    a = np.empty((len(sums), len(EXPERTS), len(EXPERTS)))
    for k, (i, j) in enumerate(forms.PAIRS):
        a[:, i, j] = a[:, j, i] = sums[:, k]
    b = sums[:, len(forms.PAIRS) :]
    return a[:, slots][:, :, slots], b[:, slots]


@dataclass(frozen=True)
class Interpolation:
    """The eight rows that each pixel lies between, of those that any pixel needs."""

    rows: np.ndarray  # [row]: their numbers among all rows
    of_pixels: np.ndarray  # [pixel, 8]: places in `rows`
    shares: np.ndarray  # [pixel, 8]

    @classmethod
    def of(cls, table: Table) -> "Interpolation":
        below, above = forms.knots_of(table)
        (down, of_down), (across, of_across) = (
            two_cells(pixels, cells, table.cell)
            for pixels, cells in zip(below.shape, table.grid[:2], strict=True)
        )
        cells = down[:, None, :, None] * table.grid[1] + across[None, :, None, :]
        of_cells = of_down[:, None, :, None] * of_across[None, :, None, :]
        rows = cells[..., None] * table.grid[2] + np.stack([below, below + 1], -1)[:, :, None, None, :]
        shares = of_cells[..., None] * np.stack([1 - above, above], -1)[:, :, None, None, :]
        used, places = np.unique(rows.reshape(-1, 8), return_inverse=True)
        return cls(used, places.reshape(-1, 8), shares.reshape(-1, 8))

    def to_pixels(self, w: np.ndarray) -> np.ndarray:
        """`[row, …]` to `[pixel, …]`."""
        return np.einsum("pk,pk...->p...", self.shares, w[self.of_pixels])

    def to_rows(self, x: np.ndarray) -> np.ndarray:
        """`[pixel, …]` to `[row, …]`: sums over pixels by their shares."""
        flat = x.reshape(len(x), -1)
        places = self.of_pixels.ravel()
        sums = [np.bincount(places, (self.shares * column[:, None]).ravel()) for column in flat.T]
        return np.stack(sums, axis=-1).reshape(-1, *x.shape[1:])


def two_cells(pixels: int, cells: int, size: int) -> tuple[np.ndarray, np.ndarray]:
    """The cells that each pixel lies between, `[pixel, 2]`, and its shares of them."""
    shares = forms.between(pixels, cells, size)
    first = np.minimum((shares > 0).argmax(axis=1), max(cells - 2, 0))
    both = np.stack([first, np.minimum(first + 1, cells - 1)], axis=1)
    of_both = np.take_along_axis(shares, both, axis=1)
    if cells == 1:
        of_both[:, 1] = 0
    return both, of_both


class Layer:
    """A layer of a picture, the reflected or the emitted one, whose experts are weighed."""

    def __init__(self, table: Table, weights: np.ndarray) -> None:
        """With the weights that are begun with, `[cell's row, cell's column, knot, expert]`."""
        self.between = Interpolation.of(table)
        experts, channels = table.changes.shape[:2]
        self.changes = table.changes.reshape(experts, channels, -1).astype(np.float64)
        self.w = self.ahead = weights.reshape(-1, experts)[self.between.rows]

    def prepare(self, weight: np.ndarray, layers: np.ndarray) -> None:
        """For squares times `weight`, `[channel, pixel]`, of pixels that so many layers change."""
        a = np.einsum("cp,icp,jcp->pij", layers * weight, self.changes, self.changes, optimize=True)
        self.steps = Simplex(self.between.to_rows(a))

    def changed(self, w: np.ndarray) -> np.ndarray:
        return np.einsum("pi,icp->cp", self.between.to_pixels(w), self.changes, optimize=True)

    def slope(self, weighted: np.ndarray) -> np.ndarray:
        """Half of the form's, `[row, expert]`, for T − R times the weight of its square."""
        return self.between.to_rows(np.einsum("icp,cp->pi", self.changes, weighted, optimize=True))


def best(rest: np.ndarray, layers: list[Layer], halves: np.ndarray, metric: int) -> np.ndarray:
    """T `[channel, y, x]` by the best weights that there are of these layers, whose error is proven to be the
    least but for `PRECISION`.

    The form of all rows together is at most the sum of their own, with each pixel counted by its shares, and
    for each of the layers that change it, so that steps by these, row by row, never lead up. They have
    momentum, as Beck and Teboulle, *A Fast Iterative Shrinkage-Thresholding Algorithm*, 2009, which starts
    again where it points up (O'Donoghue and Candès 2015).
    """
    channels = len(rest)
    weight = forms.importance(halves)[metric].reshape(channels, -1)
    lacking = (halves.mean(axis=0) - rest).reshape(channels, -1)
    counts = sum((layer.changes != 0).any(axis=(0, 1)).astype(int) for layer in layers)
    for layer in layers:
        layer.prepare(weight, np.maximum(counts, 1))

    def off(name: str) -> np.ndarray:
        """T − R."""
        return sum(layer.changed(getattr(layer, name)) for layer in layers) - lacking

    momentum = 1.0
    for step in range(STEPS):
        if step % STEPS_BETWEEN_CHECKS == 0:
            now = off("w")
            # The form is convex: it is nowhere on the simplex less than its tangent plane is.
            gap = 0.0
            for layer in layers:
                down = layer.slope(weight * now)
                gap += 2 * float((down * layer.w).sum() - np.minimum(down.min(axis=1), 0).sum())
            if gap <= PRECISION * (weight * now**2).sum():
                break
        weighted = weight * off("ahead")
        after, up = [], 0.0
        for layer in layers:
            a = layer.steps.a
            to = np.einsum("rij,rj->ri", a, layer.ahead) - layer.slope(weighted)
            after.append(layer.steps.best(to))
            up += np.einsum("ri,rij,rj->", layer.ahead - after[-1], a, after[-1] - layer.w)
        momentum = 1.0 if up > 0 else momentum
        faster = (1 + np.sqrt(1 + 4 * momentum**2)) / 2
        for layer, w in zip(layers, after, strict=True):
            layer.ahead = w + (momentum - 1) / faster * (w - layer.w)
            layer.w = w
        momentum = faster
    else:
        print(f"the best weights are not found: {gap / (weight * now**2).sum():.1g} is left", file=sys.stderr)
    return rest + sum(layer.changed(layer.w) for layer in layers).reshape(rest.shape)
