"""The Bayes limit against closed forms, brute force, and other estimates."""

from fractions import Fraction
from math import comb

import numpy as np
import pytest
import torch

from nst_train import bayes, families
from nst_train.errors import UserError
from nst_train.families import FAMILIES, GaussianStep


def moment(k: int, n: int) -> Fraction:
    """∫ t^k (1 − t)^(n − k) dt over [1/10, 3/10], term by term."""
    low, high = Fraction(1, 10), Fraction(3, 10)
    return sum(
        Fraction(comb(n - k, j) * (-1) ** j, k + j + 1) * (high ** (k + j + 1) - low ** (k + j + 1))
        for j in range(n - k + 1)
    )


@pytest.mark.parametrize(("k", "n"), [(0, 8), (1, 8), (3, 8), (8, 8), (5, 32)])
def test_steps_have_a_closed_form(k: int, n: int) -> None:
    samples = np.zeros((1, n))
    samples[0, :k] = 0.75
    height = 0.75 if k else 1.25
    exact = height * float(moment(k + 1, n + 1) / moment(k, n))
    assert bayes.limit("step", samples) == pytest.approx([exact], rel=1e-6)
    wrong = height * float(moment(k + 1, n + 1) / moment(k, n + 1))
    assert bayes.limit("step", samples) != pytest.approx([wrong], rel=1e-3)


@pytest.mark.parametrize("edge", [1.0, 0.5])
def test_gaussians_agree_with_brute_force(edge: float) -> None:
    """E[I | y within δ of the samples], from 4 million integrands with one sequence of two samples
    each. Some 6,000 of them match, which leaves the mean an error of 0.09 / √6000 = 0.0012 (1 σ)."""
    rng = np.random.default_rng(1)
    y = np.array([1.0, 1.2])
    mu, sigma = rng.uniform(0.1, 0.3, (2, 4_000_000))
    x = rng.random((2, 4_000_000))
    density = np.exp(-0.5 * ((x - mu) / sigma) ** 2) / (sigma * np.sqrt(2 * np.pi)) * (x < edge)
    match = (np.abs(density - y[:, None]) < 0.06).all(axis=0)
    scale = torch.from_numpy(1.0 / (sigma[match] * np.sqrt(2.0)))
    mu = torch.from_numpy(mu[match])
    integrals = 0.5 * (torch.erf((edge - mu) * scale) + torch.erf(mu * scale))
    assert len(integrals) > 4000
    family = "gaussian" if edge == 1.0 else "gaussian-step"
    found = bayes.limit(family, y[None])[0]
    assert found == pytest.approx(integrals.mean().item(), abs=0.005)
    assert integrals.std() > 0.05, "or any answer would do"


def test_a_finer_grid_changes_little(monkeypatch: pytest.MonkeyPatch) -> None:
    """By less than a tenth of the limit's own error, at the largest n, where it is the narrowest."""
    samples = families.held_out_samples("gaussian", 4, 64, 1)
    reference = families.references(families.integrands("gaussian", families.TEST_GRID)).numpy()
    coarse = bayes.limit("gaussian", samples)
    monkeypatch.setattr(bayes, "DEVIATIONS", 4 * bayes.DEVIATIONS)
    monkeypatch.setattr(bayes, "MEANS", 4 * bayes.MEANS)
    fine = bayes.limit("gaussian", samples)
    error = np.sqrt(np.square(fine - reference[:, None]).mean())
    assert np.sqrt(np.square(fine - coarse).mean()) < 0.1 * error


@pytest.mark.parametrize("family", FAMILIES)
def test_it_beats_the_mean_and_the_constant(family: str) -> None:
    samples = families.held_out_samples(family, 20, 16, 1)
    functions = families.integrands(family, families.TEST_GRID)
    reference = families.references(functions).numpy()[:, None]

    def mse(estimates: np.ndarray) -> float:
        return float(np.square(estimates - reference).mean())

    constant = families.references(families.integrands(family, families.GRID)).mean().numpy()
    found = mse(bayes.limit(family, samples))
    assert found < 0.5 * mse(samples.mean(axis=-1))
    assert found < 0.5 * mse(np.broadcast_to(constant, reference.shape))


def test_zeros_say_nothing_about_a_gaussian_below_a_fixed_step() -> None:
    prior = bayes.limit("gaussian-step", np.zeros((1, 5)))
    grid = bayes.midpoints(0.1, 0.3, 50)
    mean = np.mean([GaussianStep(m, s, 0.5).integral() for m in grid for s in grid])
    assert prior == pytest.approx([mean], abs=1e-4)
    one = np.array([[1.7]])
    assert bayes.limit("gaussian-step", np.array([[1.7, 0.0]])) == bayes.limit("gaussian-step", one)


def test_impossible_samples_are_an_error() -> None:
    with pytest.raises(UserError, match="no parameters explain the samples of run 0"):
        bayes.limit("gaussian", np.array([[5.0, 1.0]]))  # no peak is above 3.99
