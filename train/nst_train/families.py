"""The one-dimensional integrands of section 4.1, on [0, 1] with uniform samples.

Training integrands lie on a 9×9 grid of parameters that includes its corners. Test integrands, 9 per
family, take every third value of that grid shifted by half a step, so that none of them was trained
on. (The paper shifts by 0.05, which on this grid of step 0.025 would land on training parameters.)

| family        | f(x)                    | first parameter | second parameter |
|---------------|-------------------------|-----------------|------------------|
| gaussian      | N(x; μ, σ)              | μ in [0.1, 0.3] | σ in [0.1, 0.3]  |
| step          | h · 1[x < t]            | t in [0.1, 0.9] | h in [0.5, 2]    |
| gaussian-step | N(x; μ, σ) · 1[x < t]   | μ in [0.1, 0.3] | σ in [0.1, 0.3]  |

The t of a gaussian-step is drawn uniformly from [0.1, 0.9] for each integrand.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from math import erf, pi, sqrt
from typing import Protocol

import numpy as np
import torch

from nst_train.sequences import Data, Sequences, concatenate, progressive_means

GRID = np.arange(9) / 8
"""Training parameters, as positions between the ends of their range."""

TEST_GRID = (np.array([0, 3, 6]) + 0.5) / 8

MEAN_RANGE = (0.1, 0.3)
DEVIATION_RANGE = (0.1, 0.3)
THRESHOLD_RANGE = (0.1, 0.9)
HEIGHT_RANGE = (0.5, 2.0)


class Integrand(Protocol):
    """A function on [0, 1] whose integral is known."""

    def __call__(self, x: np.ndarray) -> np.ndarray: ...

    def integral(self) -> float: ...


def normal_cdf(z: float) -> float:
    """Φ(z), the standard normal distribution function."""
    return 0.5 * (1.0 + erf(z / sqrt(2.0)))


@dataclass(frozen=True)
class GaussianStep:
    """N(x; μ, σ) · 1[x < t]."""

    mu: float
    sigma: float
    t: float

    def __call__(self, x: np.ndarray) -> np.ndarray:
        density = np.exp(-0.5 * ((x - self.mu) / self.sigma) ** 2) / (self.sigma * sqrt(2.0 * pi))
        return density * (x < self.t)

    def integral(self) -> float:
        """Φ((t − μ)/σ) − Φ(−μ/σ)."""
        return normal_cdf((self.t - self.mu) / self.sigma) - normal_cdf(-self.mu / self.sigma)


def gaussian(mu: float, sigma: float) -> GaussianStep:
    """N(x; μ, σ) on [0, 1]; x = 1 has probability 0."""
    return GaussianStep(mu, sigma, t=1.0)


@dataclass(frozen=True)
class Step:
    """h · 1[x < t]."""

    t: float
    h: float

    def __call__(self, x: np.ndarray) -> np.ndarray:
        return self.h * (x < self.t)

    def integral(self) -> float:
        return self.h * self.t


FAMILIES = ("gaussian", "step", "gaussian-step")


def integrands(family: str, grid: np.ndarray, rng: np.random.Generator) -> list[Integrand]:
    """One integrand per pair of positions in `grid`; `rng` draws what the grid leaves open."""
    pairs = [(u, v) for u in grid.tolist() for v in grid.tolist()]

    def at(position: float, ends: tuple[float, float]) -> float:
        return ends[0] + position * (ends[1] - ends[0])

    match family:
        case "gaussian":
            return [gaussian(at(u, MEAN_RANGE), at(v, DEVIATION_RANGE)) for u, v in pairs]
        case "step":
            return [Step(at(u, THRESHOLD_RANGE), at(v, HEIGHT_RANGE)) for u, v in pairs]
        case "gaussian-step":
            return [
                GaussianStep(
                    at(u, MEAN_RANGE), at(v, DEVIATION_RANGE), rng.uniform(*THRESHOLD_RANGE)
                )
                for u, v in pairs
            ]
        case _:
            raise ValueError(f"no family is called {family!r}")


def sample(
    functions: Iterable[Integrand], runs: int, terms: int, rng: np.random.Generator
) -> Sequences:
    """Independent runs of progressive estimates for each function."""
    functions = list(functions)
    samples = np.stack([function(rng.random((runs, terms))) for function in functions])
    reference = torch.tensor([function.integral() for function in functions], dtype=torch.float32)
    return Sequences(progressive_means(samples), reference)


def make_data(families: list[str], runs: int, terms: int, seed: int) -> Data:
    """Training and test sequences; those of one family do not depend on which others are asked for."""

    def draw(family: str, grid: np.ndarray, split: int) -> Sequences:
        rng = np.random.default_rng([seed, FAMILIES.index(family), split])
        return sample(integrands(family, grid, rng), runs, terms, rng)

    training = [draw(family, GRID, split=0) for family in families]
    held_out = {family: draw(family, TEST_GRID, split=1) for family in families}
    if len(families) > 1:
        held_out["all"] = concatenate(list(held_out.values()))
    trained_on = ",".join(f"family:{family}" for family in families)
    return Data(concatenate(training), held_out, trained_on)
