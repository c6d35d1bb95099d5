"""The one-dimensional integrands of section 4.1, on [0, 1] with uniform samples.

| family        | f(x)                      | first parameter | second parameter |
|---------------|---------------------------|-----------------|------------------|
| gaussian      | N(x; μ, σ)                | μ in [0.1, 0.3] | σ in [0.1, 0.3]  |
| step          | h · 1[x < t]              | t in [0.1, 0.3] | h in [0.5, 2]    |
| gaussian-step | N(x; μ, σ) · 1[x < 1/2]   | μ in [0.1, 0.3] | σ in [0.1, 0.3]  |

The paper gives the square of the Gaussians' parameters, and none for the others. Here the edge of a step
has the Gaussians' range: over [0.1, 0.9] even the best possible estimate (`bayes.py`) has 0.67 times the
error of S_8, so that gains like the paper's are impossible. A pair (μ, σ) leaves no third parameter, so
the step that multiplies a Gaussian is always the same.

The 81 training integrands of a family take the left ends of 9×9 equal cells of the square. The 9 test
integrands take the left ends of 3×3 cells, shifted by a quarter of the range: for the Gaussians the
paper's 0.05. None of them is a training integrand. `held_out.py` writes them for `nst bench stability`.
"""

from dataclasses import dataclass
from math import erf, pi, sqrt
from typing import Protocol

import numpy as np
import torch

from nst_train.sequences import Data, Sequences, concatenate, progressive_means

GRID = np.arange(9) / 9
"""Training parameters, as positions between the ends of their range."""

TEST_GRID = np.arange(3) / 3 + 0.25

MEAN_RANGE = (0.1, 0.3)
DEVIATION_RANGE = (0.1, 0.3)
EDGE_RANGE = (0.1, 0.3)
HEIGHT_RANGE = (0.5, 2.0)
GAUSSIAN_STEP_EDGE = 0.5


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


def integrands(family: str, grid: np.ndarray) -> list[Integrand]:
    """One integrand per pair of positions in `grid`."""

    def at(position: float, ends: tuple[float, float]) -> float:
        return ends[0] + position * (ends[1] - ends[0])

    def make(u: float, v: float) -> Integrand:
        match family:
            case "gaussian":
                return gaussian(at(u, MEAN_RANGE), at(v, DEVIATION_RANGE))
            case "step":
                return Step(at(u, EDGE_RANGE), at(v, HEIGHT_RANGE))
            case "gaussian-step":
                mu, sigma = at(u, MEAN_RANGE), at(v, DEVIATION_RANGE)
                return GaussianStep(mu, sigma, GAUSSIAN_STEP_EDGE)
            case _:
                raise ValueError(f"no family is called {family!r}")

    return [make(u, v) for u in grid.tolist() for v in grid.tolist()]


def sample(functions: list[Integrand], shape: tuple[int, ...], rng: np.random.Generator) -> np.ndarray:
    """f(X) for uniform X, `[integrand, *shape]`, f64."""
    return np.stack([function(rng.random(shape)) for function in functions])


def references(functions: list[Integrand]) -> torch.Tensor:
    """I, `[integrand]`."""
    return torch.tensor([function.integral() for function in functions], dtype=torch.float32)


def held_out_samples(family: str, runs: int, terms: int, seed: int) -> np.ndarray:
    """The samples behind the test sequences of `make_data`, `[integrand, run, term]`."""
    functions = integrands(family, TEST_GRID)
    return sample(functions, (runs, terms), _rng(family, seed, split=1))


def make_data(families: list[str], runs: int, terms: int, seed: int) -> Data:
    """Training and test sequences; those of one family do not depend on the other families."""

    def training(family: str) -> Sequences:
        functions = integrands(family, GRID)
        samples = sample(functions, (runs, terms), _rng(family, seed, split=0))
        return Sequences(progressive_means(samples), references(functions))

    def test(family: str) -> Sequences:
        samples = held_out_samples(family, runs, terms, seed)
        return Sequences(progressive_means(samples), references(integrands(family, TEST_GRID)))

    held_out = {family: test(family) for family in families}
    if len(families) > 1:
        held_out["all"] = concatenate(list(held_out.values()))
    trained_on = ",".join(f"family:{family}" for family in families)
    return Data(concatenate([training(family) for family in families]), held_out, trained_on)


def _rng(family: str, seed: int, split: int) -> np.random.Generator:
    return np.random.default_rng([seed, FAMILIES.index(family), split])
