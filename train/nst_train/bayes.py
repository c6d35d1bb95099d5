"""The Bayes limit of the 1D families: no estimate from the same unordered samples does better on average.

    T_n = E[I | y_1 … y_n] = ∫ I(θ) Π_i p(y_i | θ) dθ / ∫ Π_i p(y_i | θ) dθ

with θ uniform over the family's square of parameters, and y_i = f_θ(X_i) for uniform X_i.

*Steps.* A sample is h with probability t, else 0. A sample that is not 0 is h; if k of n are not 0, t has
the density t^k (1 − t)^(n−k) over its range. The integrals over t are sums over `CELLS` midpoints. If all
samples are 0, they say nothing about h.

*Gaussians*, below a step at `edge` or without one (edge 1). A sample y > 0 has come from x = μ ± d, where
d = σ √(2 log(1/(σ √(2π) y))), and f' = y d/σ² there, so

    p(y | μ, σ) = σ²/(y d) · (1[μ − d ≥ 0] + 1[μ + d ≤ edge]),

and 0 if y is above the peak 1/(σ √(2π)). A sample y = 0 has the probability 1 − edge for every θ. The
largest sample bounds σ from above, and near that bound σ* the density grows like (σ* − σ)^(−1/2):
σ = σ* − (σ* − 0.1) u⁴ with u on midpoints of [0, 1] makes it finite, and puts most points where the
posterior is large. μ takes midpoints of its range; given σ, the density is piecewise constant in it.
"""

from math import pi, sqrt

import numpy as np
import torch
from torch import Tensor

from nst_train.errors import UserError
from nst_train.families import (
    DEVIATION_RANGE,
    EDGE_RANGE,
    GAUSSIAN_STEP_EDGE,
    HEIGHT_RANGE,
    MEAN_RANGE,
)

CELLS = 20_000
"""Midpoints of t: thousands for each standard deviation of its posterior, also at n = 64."""

DEVIATIONS = 160
MEANS = 80
"""Midpoints of σ and μ on the first grid; a test compares with a grid four times as fine."""

MOST_REFINEMENTS = 4
"""Grids for a run: each next one has twice the points, until one of its points explains all samples."""

CROWDING = 4
"""The power of u, see above."""


def limit(family: str, samples: np.ndarray) -> np.ndarray:
    """E[I | samples] along the last axis of `[…, n]`, in f64."""
    runs = samples.reshape(-1, samples.shape[-1])
    match family:
        case "step":
            means = step(runs)
        case "gaussian":
            means = gaussian(runs, edge=1.0)
        case "gaussian-step":
            means = gaussian(runs, edge=GAUSSIAN_STEP_EDGE)
        case _:
            raise ValueError(f"no family is called {family!r}")
    return means.reshape(samples.shape[:-1])


def midpoints(low: float, high: float, count: int) -> np.ndarray:
    """The midpoints of `count` equal cells."""
    return low + (high - low) * (np.arange(count) + 0.5) / count


def step(samples: np.ndarray) -> np.ndarray:
    """`[run, n]` to `[run]`."""
    n = samples.shape[1]
    positive = (samples > 0).sum(axis=1)
    height = np.where(positive > 0, samples.max(axis=1), sum(HEIGHT_RANGE) / 2)
    t = midpoints(*EDGE_RANGE, CELLS)
    means = np.empty(n + 1)
    for k in np.unique(positive):
        log_density = k * np.log(t) + (n - k) * np.log1p(-t)
        density = np.exp(log_density - log_density.max())
        means[k] = (t * density).sum() / density.sum()
    return height * means[positive]


def gaussian(samples: np.ndarray, edge: float) -> np.ndarray:
    """`[run, n]` to `[run]`."""
    means = np.empty(len(samples))
    for run, row in enumerate(samples):
        positive = torch.from_numpy(row[row > 0])
        for refinement in range(MOST_REFINEMENTS):
            mean = _gaussian_mean(positive, edge, DEVIATIONS << refinement, MEANS << refinement)
            if mean is not None:
                break
        else:
            # The posterior is narrower than the finest grid, or these are other samples.
            raise UserError(f"Bayes limit: no parameters explain the samples of run {run}")
        means[run] = mean
    return means


def _gaussian_mean(y: Tensor, edge: float, deviations: int, means: int) -> float | None:
    """The posterior mean, on a grid; `None` if the samples contradict each of its points."""
    low, high = DEVIATION_RANGE
    if len(y):
        high = min(high, 1.0 / (sqrt(2.0 * pi) * y.max().item()))
    if high <= low:
        return None
    u = torch.from_numpy(midpoints(0.0, 1.0, deviations))
    sigma = high - (high - low) * u**CROWDING
    log_weight = (CROWDING - 1) * torch.log(u)  # dσ is proportional to u³ du
    mu = torch.from_numpy(midpoints(*MEAN_RANGE, means))

    log_ratio = -torch.log(sigma[:, None] * sqrt(2.0 * pi) * y)  # log(peak/y), [σ, sample]
    d = sigma[:, None] * torch.sqrt(2.0 * log_ratio.clamp_min(0.0))
    # log(σ²/(y d)) but for y, which is the same for all θ
    log_weight = log_weight + (2.0 * torch.log(sigma[:, None]) - torch.log(d)).sum(dim=1)

    # Of d_1 < d_2 < …, those up to μ have the left branch, those up to edge − μ the right one.
    d = torch.sort(d, dim=1).values.contiguous()
    left = torch.searchsorted(d, mu.expand(deviations, means).contiguous(), right=True)  # [σ, μ]
    right = torch.searchsorted(d, (edge - mu).expand(deviations, means).contiguous(), right=True)
    possible = torch.maximum(left, right) == len(y)
    both = torch.minimum(left, right)  # samples with two branches
    log_density = log_weight[:, None] + both * np.log(2.0)
    log_density = torch.where(possible & log_density.isfinite(), log_density, -torch.inf)
    if not possible.any() or log_density.max() == -torch.inf:
        return None
    density = torch.exp(log_density - log_density.max())
    return ((density * _integrals(mu, sigma, edge)).sum() / density.sum()).item()


def _integrals(mu: Tensor, sigma: Tensor, edge: float) -> Tensor:
    """Φ((edge − μ)/σ) − Φ(−μ/σ), `[σ, μ]`."""
    scale = 1.0 / (sigma[:, None] * sqrt(2.0))
    return 0.5 * (torch.erf((edge - mu) * scale) + torch.erf(mu * scale))
