"""Closed forms against quadrature, and what the data sets contain."""

import numpy as np
import pytest
import torch

from nst_train.families import (
    FAMILIES,
    GRID,
    TEST_GRID,
    GaussianStep,
    gaussian,
    integrands,
    make_data,
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
    functions = integrands(family, grid, np.random.default_rng(1))
    assert len(functions) == len(grid) ** 2
    for function in functions[::7] + functions[-1:]:
        assert function.integral() == pytest.approx(quadrature(function), abs=QUADRATURE_TOLERANCE)


def test_quadrature_catches_a_wrong_integral() -> None:
    """Forgetting the mass of the Gaussian below 0 is far outside the tolerance."""
    function = gaussian(0.1, 0.1)
    assert abs(1.0 - quadrature(function)) > 1000 * QUADRATURE_TOLERANCE


@pytest.mark.parametrize("family", FAMILIES)
def test_test_integrands_are_not_trained_on(family: str) -> None:
    rng = np.random.default_rng(1)
    trained = set(integrands(family, GRID, rng))
    tested = integrands(family, TEST_GRID, rng)
    assert len(trained) == 81 and len(tested) == 9
    assert trained.isdisjoint(tested)
    for function in tested:
        if isinstance(function, GaussianStep):
            assert all((function.mu, function.sigma) != (f.mu, f.sigma) for f in trained)


def test_grid_covers_the_ranges_of_the_paper() -> None:
    functions = integrands("gaussian", GRID, np.random.default_rng(1))
    assert (functions[0].mu, functions[0].sigma) == (0.1, 0.1)
    assert (functions[-1].mu, functions[-1].sigma) == pytest.approx((0.3, 0.3))


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
    (function,) = integrands("step", np.array([0.5]), np.random.default_rng(1))  # t = 0.5, h = 1.25
    sequences = sample([function], runs=20_000, terms=16, rng=np.random.default_rng(2))
    errors = mean_squared_errors(sequences.estimates, sequences.reference)[0]
    expected = 1.25**2 * 0.25 / torch.arange(1, 17)
    torch.testing.assert_close(errors, expected, rtol=0.05, atol=0)


def test_windows_hold_the_latest_estimate_last() -> None:
    estimates = progressive_means(np.array([[[1.0, 3.0, 8.0, 0.0]]]))
    assert estimates.tolist() == [[[1.0, 2.0, 4.0, 3.0]]]
    assert windows(estimates, 3).tolist() == [[[[1.0, 2.0, 4.0], [2.0, 4.0, 3.0]]]]
