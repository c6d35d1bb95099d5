"""What networks that see the samples read: power means of a lane's samples, without a unit.

Of the n samples y_i of a lane, in whatever order, sums are kept, from which come

    m_p = mean of φ_p(y_i),   φ_p(y) = |y|^p,   but φ_1(y) = y,   and φ_0(y) = 1 where y ≠ 0, else 0
    M_p = |m_p|^(1/p)  for p > 0

m_1 is the plain estimate S. The *unit* u is the mean of |S| over all lanes of the batch. With a small
number, `floor`, that stands for nothing,

    L_p = log(M_p/u + floor)

For the powers p_1 < p_2 < … < p_K above 0 the network reads, in this order,

    L_1,   L_{p_2} − L_{p_1},  …,  L_{p_K} − L_{p_{K−1}},   m_0 (if 0 is among the powers),   log k,   1/k

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


@dataclass(frozen=True)
class PowerMeans:
    """Which power means, and how the output is scaled: equations above."""

    powers: list[float]  # ascending, not negative, 1 among them
    floor: float  # in units of u
    scale_estimate: float
    scale_unit: float

    def mistake(self) -> tuple[str, str] | None:
        """The first field that does not fit, and what it must be."""
        ascending = all(a < b for a, b in pairwise(self.powers))
        finite = all(0 <= p < math.inf for p in self.powers)
        if not (ascending and finite and 1 in self.powers):
            return "powers", "numbers of 0 or more, ascending, 1 among them"
        if not 0 < self.floor < math.inf:
            return "floor", "a positive number"
        for key in ("scale_estimate", "scale_unit"):
            if not 0 <= getattr(self, key) < math.inf:
                return key, "0 or more"
        if self.scale_estimate + self.scale_unit == 0:
            return "scale_unit", "positive if scale_estimate is 0"
        return None

    @property
    def positive(self) -> list[float]:
        """The powers that have a mean M_p."""
        return [p for p in self.powers if p > 0]

    @property
    def width(self) -> int:
        """The number of inputs: one for each power, and two of n."""
        return len(self.powers) + 2

    def features(self, samples: Tensor) -> Tensor:
        """φ_p(y) of samples `[…]`, `[power, …]`."""
        found: dict[float, Tensor] = {}
        for p in self.powers:
            if p == 0:
                found[p] = (samples != 0).to(samples.dtype)
            elif p == 1:
                found[p] = samples
            elif p / 2 in found:  # powers that double are cheap
                found[p] = found[p / 2].square()
            else:
                found[p] = samples.abs().pow(p)
        return torch.stack(list(found.values()))

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
        index = self.powers.index
        log = {p: (means[index(p)].abs().pow(1 / p) / unit + self.floor).log() for p in self.positive}
        values = list(log.values())
        columns = [log[1], *(b - a for a, b in pairwise(values))]
        if 0 in self.powers:
            columns.append(means[index(0)])
        one = torch.ones_like(log[1])
        return torch.stack([*columns, one * k.log(), one / k], dim=-1)

    def scale(self, estimate: Tensor, unit: Tensor) -> Tensor:
        """s, what an output of 1 adds to S."""
        return self.scale_estimate * estimate.abs() + self.scale_unit * unit
