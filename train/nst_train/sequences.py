"""Sequences of progressive estimates, stored `[integrand, run, term]`."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor


@dataclass(frozen=True)
class Sequences:
    """Independent runs of S_1 … S_N for a number of integrands, and the values they converge to.

    For a rendering, an integrand is one channel of one pixel.
    """

    estimates: Tensor  # [integrand, run, term], S_n at index n - 1
    reference: Tensor  # [integrand], I
    samples: Tensor | None = None  # [integrand, run, term], where a network sees them


@dataclass(frozen=True)
class Data:
    """What a network is trained on, and what it is scored on."""

    training: Sequences
    held_out: dict[str, Sequences]  # by the name they have in metrics.csv
    trained_on: str  # for the metadata of the weights


def progressive_means(samples: np.ndarray) -> Tensor:
    """S_n = mean of the first n samples (equation 1), along the last axis; summed in f64."""
    counts = np.arange(1, samples.shape[-1] + 1)
    means = np.cumsum(samples, axis=-1, dtype=np.float64) / counts
    return torch.from_numpy(means.astype(np.float32))


def windows(estimates: Tensor, window: int) -> Tensor:
    """The network's inputs (section 3.1): S_{n-M+1} … S_n, oldest first, for n = M … N.

    `[…, term]` becomes a view `[…, n - M, M]`.
    """
    return estimates.unfold(-1, window, 1)


def mean_squared_errors(estimates: Tensor, reference: Tensor) -> Tensor:
    """Equations 3 and 4: the squared error averaged over runs, `[integrand, n]`."""
    return (estimates - reference[:, None, None]).square().mean(dim=1)


LEAST_DEVIATION = 1e-3
"""Axes of `whitening` with a smaller part of the greatest standard deviation count as this part: beyond
it, f32 weights that undo the scaling would show their rounding."""


def whitening(estimates: Tensor, window: int) -> tuple[Tensor, Tensor]:
    """The mean of all windows, `[window]`, and the basis `[window, window]` that makes their principal
    axes uncorrelated and of variance 1, in f64.

    Estimates follow each other closely, so a window's differences are far smaller than its mean;
    the smaller their ratio, the slower is gradient descent on raw windows.
    """
    terms = estimates.shape[-1]
    total = torch.zeros(window, dtype=torch.float64, device=estimates.device)
    squares = torch.zeros(window, window, dtype=torch.float64, device=estimates.device)
    for first in range(terms - window + 1):  # bit by bit: all windows in f64 are many times the data
        part = estimates[..., first : first + window].reshape(-1, window).double()
        total += part.sum(dim=0)
        squares += part.T @ part
    count = estimates[..., 0].numel() * (terms - window + 1)
    return whitening_of(total / count, squares / count)


def whitening_of(mean: Tensor, squares: Tensor, drop: bool = False) -> tuple[Tensor, Tensor]:
    """As `whitening`, of inputs whose mean is `[input]`, and that of their products `[input, input]`.

    With `drop`, axes below `LEAST_DEVIATION` become 0: what does not vary in training says nothing of it,
    but would be magnified elsewhere.
    """
    variances, axes = torch.linalg.eigh(squares - mean.outer(mean))
    deviations = variances.clamp_min(0.0).sqrt()
    least = LEAST_DEVIATION * deviations[-1]
    basis = (axes / deviations.clamp_min(least)).T
    if drop:
        basis[deviations < least] = 0.0
    return mean, basis


def concatenate(parts: list[Sequences]) -> Sequences:
    """All integrands of `parts`, in order."""
    samples = [part.samples for part in parts if part.samples is not None]
    return Sequences(
        estimates=torch.cat([part.estimates for part in parts]),
        reference=torch.cat([part.reference for part in parts]),
        samples=torch.cat(samples) if len(samples) == len(parts) else None,
    )
