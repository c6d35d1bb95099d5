"""Classical transformations, as in `nst`: the same windows, and the same rules for when S_n is returned.

Each is a function of the last terms of sequences, `[…, term]` in f64, with their sample counts n,
consecutive, and returns limits `[…]`, NaN where a denominator vanishes.
"""

from collections.abc import Callable

import numpy as np

Limit = Callable[[np.ndarray, np.ndarray], np.ndarray]

FARTHEST = 10.0
"""How far a limit may lie from S_N, in units of n_N/(n_N − n_1) times the window's spread; as in `nst`."""


def difference(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """a − b, or 0 where the difference is only rounding in f64."""
    d = a - b
    rounding = 4.0 * np.finfo(np.float64).eps * np.maximum(np.abs(a), np.abs(b))
    return np.where(np.abs(d) <= rounding, 0.0, d)


def aitken(counts: np.ndarray, terms: np.ndarray) -> np.ndarray:
    """Aitken's Δ² of three terms: S_{k+2} − (ΔS_{k+1})²/Δ²S_k."""
    a, b, c = (terms[..., k] for k in range(3))
    denominator = difference(c - b, b - a)
    with np.errstate(all="ignore"):
        limit = c - (c - b) * ((c - b) / denominator)
    return np.where(denominator == 0.0, np.nan, limit)


def levin_u(counts: np.ndarray, terms: np.ndarray) -> np.ndarray:
    """Levin's u of eight terms: δ^6(S_n/ω_n)/δ^6(1/ω_n) with ω_n = n ΔS_{n−1} and divided differences
    δ^k with respect to 1/n (the W-algorithm: Sidi 2003, section 7.2)."""
    order = terms.shape[-1] - 2
    last = terms[..., -1:]
    with np.errstate(all="ignore"):
        step = difference(terms[..., 1:], terms[..., :-1])
        denominator = (np.diff(counts) / counts[1:]) / step
        numerator = (terms[..., 1:] - last) * denominator
        t = 1.0 / counts[1:]
        for p in range(1, order + 1):
            scale = 1.0 / (t[p:] - t[:-p])
            numerator = (numerator[..., 1:] - numerator[..., :-1]) * scale
            denominator = difference(denominator[..., 1:], denominator[..., :-1]) * scale
        limit = last[..., 0] + numerator[..., 0] / denominator[..., 0]
    return np.where(np.isfinite(limit), limit, np.nan)


def an_gn(counts: np.ndarray, terms: np.ndarray) -> np.ndarray:
    """The a_n g_n transformation of two terms (equation 2) with g_n = 1/n."""
    n, m = counts
    return terms[..., 0] + (terms[..., 1] - terms[..., 0]) / (1.0 - n / m)


METHODS: dict[str, tuple[int, Limit]] = {
    "aitken": (3, aitken),
    "levin-u": (8, levin_u),
    "an-gn": (2, an_gn),
}
"""By the names that `nst` has for them: how many terms they read, and the function."""


def transform(method: str, estimates: np.ndarray, n: int) -> np.ndarray:
    """T_n of f32 sequences `[…, term]` that start at n = 1; S_n where the method breaks down.

    That is where the window is constant, a denominator vanishes, or the limit is not finite in f32 or
    farther away than `FARTHEST` allows.
    """
    length, limit = METHODS[method]
    window = estimates[..., n - length : n].astype(np.float64)
    counts = np.arange(n - length + 1, n + 1, dtype=np.float64)
    s = window[..., -1]
    spread = window.max(axis=-1) - window.min(axis=-1)
    farthest = FARTHEST * n / max(n - counts[0], 1.0)
    with np.errstate(all="ignore"):
        limits = limit(counts, window)
        sound = (spread > 0.0) & (np.abs(limits - s) <= farthest * spread)
        sound &= np.isfinite(limits.astype(np.float32))
    return np.where(sound, limits, s)
