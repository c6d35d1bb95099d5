"""Sequences of integrands that are seen once: a family's parameters are drawn anew for every lane.

Parameters are uniform over the square of `families`, whose held-out integrands are never met exactly.
"""

from dataclasses import dataclass
from math import pi, sqrt

import torch
from torch import Tensor

from nst_train import families
from nst_train.families import FAMILIES, GAUSSIAN_STEP_EDGE, TEST_GRID
from nst_train.sequences import Data, Sequences, concatenate, progressive_means

FIRST = 10_000
"""Integrands of each family in `Data.training`: they give the errors of S and the scale of inputs."""


@dataclass(frozen=True)
class Lanes:
    """One run of each of some integrands."""

    samples: Tensor  # [lane, term], f32
    reference: Tensor  # [lane], I, f32

    def __len__(self) -> int:
        return len(self.reference)


def draw(family: str, lanes: int, terms: int, rng: torch.Generator) -> Lanes:
    """Lanes of integrands of a family, each with parameters of its own."""

    def uniform(ends: tuple[float, float]) -> Tensor:
        return ends[0] + (ends[1] - ends[0]) * torch.rand(lanes, 1, generator=rng)

    x = torch.rand(lanes, terms, generator=rng)
    if family == "step":
        t, h = uniform(families.EDGE_RANGE), uniform(families.HEIGHT_RANGE)
        return Lanes(h * (x < t), (h * t)[:, 0])
    if family not in FAMILIES:
        raise ValueError(f"no family is called {family!r}")
    mu, sigma = uniform(families.MEAN_RANGE), uniform(families.DEVIATION_RANGE)
    edge = GAUSSIAN_STEP_EDGE if family == "gaussian-step" else 1.0
    density = torch.exp(-0.5 * ((x - mu) / sigma).square()) / (sigma * sqrt(2.0 * pi))
    width = sigma * sqrt(2.0)
    integral = 0.5 * (torch.erf((edge - mu) / width) + torch.erf(mu / width))
    return Lanes(density * (x < edge), integral[:, 0])


def join(parts: list[Lanes]) -> Lanes:
    """All lanes of `parts`, in order."""
    samples, references = zip(*((part.samples, part.reference) for part in parts), strict=True)
    return Lanes(torch.cat(samples), torch.cat(references))


def make_data(names: list[str], runs: int, terms: int, seed: int) -> Data:
    """A first draw, in the order of `names`, and the held-out runs of `families.make_data`."""
    rng = torch.Generator().manual_seed(seed)
    first = join([draw(family, FIRST, terms, rng) for family in names])
    training = Sequences(
        progressive_means(first.samples.numpy())[:, None], first.reference, first.samples[:, None]
    )

    def test(family: str) -> Sequences:
        samples = families.held_out_samples(family, runs, terms, seed)
        reference = families.references(families.integrands(family, TEST_GRID))
        return Sequences(progressive_means(samples), reference, torch.from_numpy(samples))

    held_out = {family: test(family) for family in names}
    if len(names) > 1:
        held_out["all"] = concatenate(list(held_out.values()))
    return Data(training, held_out, ",".join(f"family:{family}" for family in names))
