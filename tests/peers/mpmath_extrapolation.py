"""Limits of textbook sequences by the classical transformations, at 50 digits by mpmath.

Terms are computed and rounded in f64, then transformed at 50 digits: what is left of the error is the
method's, and that of the terms' rounding. Levin's u and Wynn's epsilon are mpmath's own; Richardson's
extrapolation is checked against mpmath's where that one applies. The others follow their definitions,
by other algorithms than the Rust code where there are any: Euler's as a binomial sum, Richardson's as
a linear system.

    "$(tools/python-env tests/peers/requirements-mpmath.txt)" tests/peers/mpmath_extrapolation.py \\
        tests/data/reference/extrapolation.csv

With --check, fails if the file is not what would be written.
"""

import argparse
import csv
import io
import sys
from collections.abc import Callable
from math import factorial, prod
from pathlib import Path

from mpmath import binomial, e, levin, lu_solve, matrix, mp, mpf, richardson, shanks, zeta

mp.dps = 50

CONSECUTIVE = [list(range(n - 7, n + 1)) for n in (8, 16, 32)]
DOUBLING = [[2**k for k in range(8)]]
TERMS = {
    "aitken": 3,
    "aitken-iterated": 7,
    "levin-u": 8,
    "brezinski-theta": 7,
    "wynn-epsilon": 7,
    "euler": 8,
    "richardson": 4,
    "an-gn": 2,
    "an-gn-square": 2,
    "an-gn-geometric": 2,
}
"""How many of the last terms each method reads."""


def partial_sums(term: Callable[[int], float], counts: list[int]) -> list[float]:
    """Sums of the first n terms, in f64."""
    total, sums = 0.0, {}
    for i in range(1, max(counts) + 1):
        total += term(i)
        sums[i] = total
    return [sums[n] for n in counts]


def sequences() -> list[tuple[str, mpf, list[int], list[float]]]:
    """Name, limit, sample counts, terms."""
    series: list[tuple[str, mpf, Callable[[int], float], list[list[int]]]] = [
        # 0.9 is no f64; the limit is that of the f64 nearest to it.
        ("linear", 1 / (1 - mpf(0.9)), lambda i: prod([0.9] * (i - 1)), CONSECUTIVE),
        ("alternating", mp.log(2), lambda i: (1 if i % 2 else -1) / i, CONSECUTIVE),
        ("logarithmic", zeta(2), lambda i: 1 / (i * i), CONSECUTIVE + DOUBLING),
        ("hyperlinear", e, lambda i: 1 / factorial(i - 1), CONSECUTIVE[:2]),
    ]
    return [
        (name, limit, counts, partial_sums(term, counts))
        for name, limit, term, all_counts in series
        for counts in all_counts
    ]


def aitken(s: list[mpf]) -> mpf:
    return (s[0] * s[2] - s[1] ** 2) / (s[2] - 2 * s[1] + s[0])


def iterated_aitken(s: list[mpf]) -> mpf:
    while len(s) > 1:
        s = [aitken(s[j : j + 3]) for j in range(len(s) - 2)]
    return s[0]


def levin_u(s: list[mpf], counts: list[int]) -> mpf:
    transformation = levin(method="levin", variant="u")
    transformation.theta = counts[1]
    for k in range(1, len(s)):
        transformation.run(s[k], s[k] - s[k - 1])
    return transformation.A[0] / transformation.B[0]


def theta(s: list[mpf], order: int, j: int) -> mpf:
    """Brezinski's theta of an order, by its definition."""
    if order < 0:
        return mpf(0)
    if order == 0:
        return s[j]
    if order % 2:
        step = theta(s, order - 1, j + 1) - theta(s, order - 1, j)
        return theta(s, order - 2, j + 1) + 1 / step
    even = theta(s, order - 2, j + 2) - theta(s, order - 2, j + 1)
    odd = [theta(s, order - 1, j + i) for i in range(3)]
    second = odd[2] - 2 * odd[1] + odd[0]
    return theta(s, order - 2, j + 1) + even * (odd[2] - odd[1]) / second


def extrapolate_to_zero(s: list[mpf], counts: list[int]) -> mpf:
    """S of the model S_n = S + c_1/n + c_2/n^2 + ..."""
    system = matrix([[mpf(n) ** -power for power in range(len(s))] for n in counts])
    limit = lu_solve(system, matrix(s))[0]
    if counts == [3, 4, 5, 6]:
        by_mpmath, _ = richardson([mpf(0)] * 3 + s + [2 * s[-1] - s[-2]])
        assert abs(limit - by_mpmath) < mpf(10) ** -40
    return limit


def an_gn(s: list[mpf], g: list[mpf]) -> mpf:
    return s[0] - (s[1] - s[0]) / (g[1] - g[0]) * g[0]


def transform(method: str, terms: list[float], counts: list[int]) -> mpf:
    s = [mpf(term) for term in terms]
    match method:
        case "aitken":
            return aitken(s)
        case "aitken-iterated":
            return iterated_aitken(s)
        case "levin-u":
            return levin_u(s, counts)
        case "brezinski-theta":
            return theta(s, 4, 0)
        case "wynn-epsilon":
            return shanks(s)[-1][-1]
        case "euler":
            k = len(s) - 1
            return sum(binomial(k, j) * s[j] for j in range(k + 1)) / mpf(2) ** k
        case "richardson":
            return extrapolate_to_zero(s, counts)
        case "an-gn":
            return an_gn(s, [1 / mpf(n) for n in counts])
        case "an-gn-square":
            return an_gn(s, [1 / mpf(n) ** 2 for n in counts])
        case "an-gn-geometric":
            return an_gn(s, [mpf(2) ** -n for n in counts])
    raise ValueError(method)


def table() -> str:
    """The file's text."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["sequence", "method", "limit", "transformed", "counts", "terms"])
    for name, limit, counts, terms in sequences():
        for method, length in TERMS.items():
            value = transform(method, terms[-length:], counts[-length:])
            writer.writerow(
                [
                    name,
                    method,
                    mp.nstr(limit, 25),
                    mp.nstr(value, 25),
                    " ".join(map(str, counts[-length:])),
                    " ".join(map(repr, terms[-length:])),
                ]
            )
    return text.getvalue()


def main() -> int:
    # mpmath's own Richardson extrapolation reads S_N ... S_2N: here S_3 ... S_6.
    counts = [3, 4, 5, 6]
    transform("richardson", partial_sums(lambda i: 1 / (i * i), counts), counts)

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("csv", type=Path)
    parser.add_argument("--check", action="store_true", help="compare instead of writing")
    args = parser.parse_args()
    if args.check:
        if args.csv.read_text(encoding="utf-8") != table():
            print(f"{args.csv} is not what this script writes", file=sys.stderr)
            return 1
        return 0
    args.csv.write_text(table(), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
