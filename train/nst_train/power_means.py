"""What networks that see the samples read: power means of a lane's samples, without a unit.

Of the n samples y_i of a lane, in whatever order, sums are kept, from which come

    m_p = mean of φ_p(y_i),   φ_p(y) = |y|^p,   but φ_1(y) = y,   and φ_½(y) = ±√|y| with the sign of y
    M_p = |m_p|^(1/p)

m_1 is the plain estimate S. Powers are powers of two, so that roots and squares alone give φ_p and M_p, and
so the same bits on every machine; ½, 1 and 2 are those whose means `nst` stores in every file. The *unit* u
is the mean of |S| over all lanes of the batch. With a small number, `floor`, that stands for nothing,

    L_p = log(M_p/u + floor)

For its powers p_1 < p_2 < … < p_K the network reads, in this order,

    L_1,   L_{p_2} − L_{p_1},  …,  L_{p_K} − L_{p_{K−1}},   log k,   1/k

with k = n, or the nearest n that it was trained on, as networks do not extrapolate well. Its output o,
linear in its last hidden layer h, changes the plain estimate:

    T = S + s·o,   o = w·h + b,   s = scale_estimate·|S| + scale_unit·u

A batch times a > 0 has the same inputs, so T(aS) = a T(S). Sums of disjoint samples add up: without some
of them, T is that of the remaining sums, with their n and their u. Logarithms and differences are taken
in f64 and then rounded to f32, as neighbouring L_p may be nearly equal.
"""

import math
from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor

POWERS = [2.0**exponent for exponent in range(-4, 5)]
"""Those that a network may have. At the ends, 1/16 and 16, f64 has room for samples up to 10^19."""


@dataclass(frozen=True)
class PowerMeans:
    """Which power means, and how the output is scaled: equations above."""

    powers: list[float]  # of `POWERS`, ascending, 1 among them
    floor: float  # in units of u
    scale_estimate: float
    scale_unit: float

    def mistake(self) -> tuple[str, str] | None:
        """The first field that does not fit, and what it must be."""
        ascending = all(a < b for a, b in pairwise(self.powers))
        if not (ascending and 1 in self.powers and set(self.powers) <= set(POWERS)):
            return "powers", "powers of two from 1/16 to 16, ascending, 1 among them"
        if not 0 < self.floor < math.inf:
            return "floor", "a positive number"
        for key in ("scale_estimate", "scale_unit"):
            if not 0 <= getattr(self, key) < math.inf:
                return key, "0 or more"
        if self.scale_estimate + self.scale_unit == 0:
            return "scale_unit", "positive if scale_estimate is 0"
        return None

    @property
    def width(self) -> int:
        """The number of inputs: one for each power, and two of n."""
        return len(self.powers) + 2

    def features(self, samples: Tensor) -> Tensor:
        """φ_p(y) of samples `[…]`, `[power, …]`."""
        return torch.stack([power(samples, p) for p in self.powers])

    def estimate(self, sums: Tensor, n: Tensor) -> Tensor:
        """S of sums `[power, …]`."""
        return sums[self.powers.index(1)] / n

    def inputs(self, sums: Tensor, n: Tensor, unit: Tensor, trained: tuple[int, int]) -> Tensor:
        """`[…, width]` of sums `[power, …]`; n and u may have any shape that broadcasts with `[…]`.

        `trained` are the least and the largest n of training.
        """
        n = n.to(sums.dtype)
        k = n.clamp(*trained)
        means = sums / n
        of_power = [power(mean.abs(), 1 / p) for mean, p in zip(means, self.powers, strict=True)]
        logs = [(mean / unit + self.floor).log() for mean in of_power]
        first = logs[self.powers.index(1)]
        columns = [first, *(b - a for a, b in pairwise(logs))]
        one = torch.ones_like(first)
        return torch.stack([*columns, one * k.log(), one / k], dim=-1)

    def scale(self, estimate: Tensor, unit: Tensor) -> Tensor:
        """s, what an output of 1 adds to S."""
        return self.scale_estimate * estimate.abs() + self.scale_unit * unit


def power(y: Tensor, p: float) -> Tensor:
    """φ_p(y) for a p of `POWERS`, by roots and squares."""
    if p == 1:
        return y
    if p == 0.5:
        return y.abs().sqrt().copysign(y)
    y = y.abs()
    for _ in range(abs(round(math.log2(p)))):
        y = y.square() if p > 1 else y.sqrt()
    return y
