"""Classical methods: against mpmath at 50 digits, and where they give up."""

import csv
from pathlib import Path

import numpy as np
import pytest

from nst_train import analytic

TABLE = Path(__file__).resolve().parents[2] / "tests/data/reference/extrapolation.csv"


def cases(method: str) -> list[dict[str, str]]:
    with TABLE.open(encoding="utf-8") as file:
        return [row for row in csv.DictReader(file) if row["method"] == method]


def numbers(text: str) -> np.ndarray:
    return np.array([float(x) for x in text.split()])


def as_good(case: dict[str, str], terms: np.ndarray) -> bool:
    """As near to the limit as mpmath's result, but for one digit. As in tests/tests/extrapolation.rs,
    the rounding of the terms, times the method's condition number, is admitted too."""
    _, function = analytic.METHODS[case["method"]]
    counts, exact_terms = numbers(case["counts"]), numbers(case["terms"])
    limit, by_mpmath = float(case["limit"]), float(case["transformed"])
    step = 2.0**-40
    base = function(counts, exact_terms)
    moved = function(counts, exact_terms * (1.0 + step * np.eye(len(exact_terms))))
    condition = max(1.0, np.nanmax(np.abs((moved - base) / base)) / step)
    allowed = max(10 * abs(by_mpmath - limit), 16 * 2.0**-52 * abs(limit) * condition)
    return bool(abs(function(counts, terms) - limit) <= allowed)


@pytest.mark.parametrize("method", analytic.METHODS)
def test_every_method_reaches_mpmaths_digits(method: str) -> None:
    found = cases(method)
    assert len(found) >= 5
    for case in found:
        assert as_good(case, numbers(case["terms"])), (case["sequence"], case["counts"])


def test_the_comparison_rejects_rounded_terms() -> None:
    precise = [
        case
        for case in cases("levin-u") + cases("aitken")
        if abs(float(case["transformed"]) / float(case["limit"]) - 1) < 1e-10
    ]
    assert len(precise) > 2
    for case in precise:
        assert not as_good(case, numbers(case["terms"]).astype(np.float32).astype(np.float64))


def test_where_a_method_breaks_down_s_stays() -> None:
    """The lanes of the test `statuses` in crates/nst-core/src/methods/extrapolation.rs."""
    nan, inf = np.nan, np.inf
    lanes = np.array(
        [
            [1.0, 1.5, 1.75],  # geometric
            [1.0, 2.0, 3.0],  # Δ² = 0
            [7.0, 7.0, 7.0],
            [nan, 1.0, 2.0],
            [1.0, 2.0, 2.9998],  # the limit is 5,000 away
            [inf, 1.0, 1.0],
            [-3e38, -1e38, 3e38],  # beyond f32
        ],
        np.float32,
    )
    t = analytic.transform("aitken", lanes, n=3)
    assert t[0] == 2.0
    np.testing.assert_array_equal(t[1:], lanes[1:, -1])


def test_an_gn_with_inverse_n_is_the_last_sample() -> None:
    samples = np.random.default_rng(1).random(12)
    means = (np.cumsum(samples) / np.arange(1, 13)).astype(np.float32)
    for n in (2, 9, 12):
        assert analytic.transform("an-gn", means, n) == pytest.approx(samples[n - 1], rel=1e-4)
