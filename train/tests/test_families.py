"""Closed forms against quadrature, and what the data sets contain."""

import numpy as np
import pytest
import torch

from nst_train import families
from nst_train.families import (
    FAMILIES,
    GRID,
    TEST_GRID,
    GaussianStep,
    gaussian,
    integrands,
    make_data,
    references,
    sample,
)
from nst_train.sequences import mean_squared_errors, progressive_means, windows

# The midpoint rule with 200,000 cells errs by at most half a cell times the jump: 2e-5 for f ≤ 8.
CELLS = 200_000
QUADRATURE_TOLERANCE = 2e-5


def quadrature(function) -> float:
    return float(function((np.arange(CELLS) + 0.5) / CELLS).mean())


@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("grid", [GRID, TEST_GRID])
def test_integral_matches_quadrature(family: str, grid: np.ndarray) -> None:
    functions = integrands(family, grid)
    assert len(functions) == len(grid) ** 2
    for function in functions[::7] + functions[-1:]:
        assert function.integral() == pytest.approx(quadrature(function), abs=QUADRATURE_TOLERANCE)


def test_quadrature_catches_a_wrong_integral() -> None:
    """Forgetting the mass of the Gaussian below 0 is far outside the tolerance."""
    function = gaussian(0.1, 0.1)
    assert abs(1.0 - quadrature(function)) > 1000 * QUADRATURE_TOLERANCE


@pytest.mark.parametrize("family", FAMILIES)
def test_test_integrands_are_not_trained_on(family: str) -> None:
    trained = set(integrands(family, GRID))
    tested = integrands(family, TEST_GRID)
    assert len(trained) == 81 and len(tested) == 9
    assert trained.isdisjoint(tested)
    for function in tested:
        if isinstance(function, GaussianStep):
            assert all((function.mu, function.sigma) != (f.mu, f.sigma) for f in trained)


def test_grids_are_left_ends_of_cells_and_the_papers_offset() -> None:
    trained, tested = integrands("gaussian", GRID), integrands("gaussian", TEST_GRID)
    assert (trained[0].mu, trained[0].sigma) == (0.1, 0.1)
    assert (trained[-1].mu, trained[-1].sigma) == pytest.approx((0.3 - 0.2 / 9, 0.3 - 0.2 / 9))
    assert (tested[0].mu, tested[0].sigma) == pytest.approx((0.1 + 0.05, 0.1 + 0.05))
    assert (tested[-1].mu, tested[-1].sigma) == pytest.approx((0.3 - 0.2 / 12, 0.3 - 0.2 / 12))


@pytest.mark.parametrize(
    ("family", "ratio"), [("gaussian", 0.0922), ("gaussian-step", 0.1609), ("step", 0.4648)]
)
def test_the_constant_has_the_error_that_its_moments_give(family: str, ratio: float) -> None:
    """Over the test integrands, E[(c − I)²] / E[Var f(X)/8] with c the training integrands' mean; the
    numbers are of numerical quadrature of f and f² and, for steps, of I = h t, Var = h² t (1 − t)."""
    constant = np.mean([f.integral() for f in integrands(family, GRID)])
    tested = integrands(family, TEST_GRID)
    x = (np.arange(CELLS) + 0.5) / CELLS
    variance = np.mean([f(x).var() for f in tested])
    error = np.mean([(constant - f.integral()) ** 2 for f in tested])
    assert error / (variance / 8) == pytest.approx(ratio, abs=1e-4)


def test_data_is_seeded_and_families_are_independent_of_each_other() -> None:
    both = make_data(["gaussian", "step"], runs=2, terms=8, seed=3)
    again = make_data(["gaussian", "step"], runs=2, terms=8, seed=3)
    alone = make_data(["step"], runs=2, terms=8, seed=3)
    other = make_data(["step"], runs=2, terms=8, seed=4)
    assert torch.equal(both.training.estimates, again.training.estimates)
    assert torch.equal(both.training.estimates[81:], alone.training.estimates)
    assert not torch.equal(other.training.estimates, alone.training.estimates)
    assert both.trained_on == "family:gaussian,family:step"
    assert list(both.held_out) == ["gaussian", "step", "all"]
    assert both.held_out["all"].estimates.shape == (18, 2, 8)


def test_estimates_are_unbiased_with_variance_over_n() -> None:
    """Var S_n = h²·t(1 − t)/n for a step; 20,000 runs estimate it to 1 % (1 σ), so 5 % is 5 σ."""
    functions = integrands("step", np.array([0.5]))  # t = 0.2, h = 1.25
    samples = sample(functions, (20_000, 16), np.random.default_rng(2))
    errors = mean_squared_errors(progressive_means(samples), references(functions))[0]
    expected = 1.25**2 * 0.2 * 0.8 / torch.arange(1, 17)
    torch.testing.assert_close(errors, expected, rtol=0.05, atol=0)


def test_samples_are_those_behind_the_test_sequences() -> None:
    data = make_data(["gaussian-step"], runs=2, terms=8, seed=3)
    samples = families.held_out_samples("gaussian-step", 2, 8, 3)
    held_out = data.held_out["gaussian-step"].estimates
    assert torch.equal(progressive_means(samples), held_out)


def test_windows_hold_the_latest_estimate_last() -> None:
    estimates = progressive_means(np.array([[[1.0, 3.0, 8.0, 0.0]]]))
    assert estimates.tolist() == [[[1.0, 2.0, 4.0, 3.0]]]
    assert windows(estimates, 3).tolist() == [[[[1.0, 2.0, 4.0], [2.0, 4.0, 3.0]]]]
