"""Measures what weights of the guard's experts could gain at most, for docs/neighbours.md: an oracle's.

    "$(tools/python-env docs/requirements-oracle.txt)" docs/neighbours_oracle.py --measure [SCENE…]
    python docs/neighbours_oracle.py            # writes the tables into the page
    python docs/neighbours_oracle.py --check    # compares instead; exit code 1 on a difference

Sequences and references are those that `docs/neighbours.py --make` has made; of them, run 0 is measured, and
has a row for each list of experts and method in docs/neighbours-oracle.csv. `--measure` asks
target/release/nst, or the binary that the environment variable NST names, for tables of what the experts
change, and goes on where it was cut off. It says where S, or T by the closed form's weights, is not as in
docs/learned-guard.csv, from which the denoiser's and the network's errors are taken.

Weights know the reference R = (R1 + R2)/2, and are the best for one metric (docs/oracle_weights.py): `near`
and `cell` by the guard's own sums, smoothed over cells and not, with what is true in place of what held-out
folds say; `both` as `near`, for emission, too (docs/oracle_emission.py), which `near`, `cell` and `surfaces`
leave as the closed form has it; `other` as `both`, but of run 1, whose samples are others; `surfaces` the
best that there are of the reflected layer, and `best` of both layers. Errors are those of
docs/neighbours.py, means of (T − R1)(T − R2). As weights were fitted to R itself, T has fitted some of its
noise, too, and these errors are, if anything, too small. `half` are the best of both layers for R1, with the
errors (T − R2)² less the noise of R2, and the other way round: they are, if anything, too large.
"""

import argparse
import csv
import math
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path
from statistics import geometric_mean
from typing import TYPE_CHECKING

from learned_guard import LEAST, LISTS
from learned_guard import TABLE as GUARDS
from neighbours import CACHE, COUNTS, DOCS, METRICS, OIDN, PAGE, PLAIN, SCENES, both, cells, halves, read
from page import fill

if TYPE_CHECKING:
    import numpy as np

TABLE = DOCS / "neighbours-oracle.csv"
COLUMNS = ["scene", "spp", "experts", "method", *METRICS]
CLOSED = "closed"
# The same, of pixels that emit alone: shares of the same mean.
AT_LAMPS = "closed at lamps"
# Kinds of weights that know the reference, and what the page calls them; it leaves `cell` out.
KINDS = {
    "near": "the guard's own sums, with what is true",
    "both": "these, for emission, too",
    "other": "these, of the other rendering",
    "surfaces": "the best of the reflected layer",
    "best": "the best of both layers",
    "half": "the best of both, by half the reference",
}
GUARD_NAMES = {"closed": "closed form", "learned": "network"}
# How far what is measured again may be from docs/learned-guard.csv, relative to that.
CLOSE = 1e-3
# How many of the pictures are shown in which the network is farthest from weights by what is true.
SHOWN = 6


def measure(scenes: list[str]) -> None:
    done = {tuple(row[name] for name in COLUMNS[:2]) for row in read(TABLE)}
    told = guards()
    new = not TABLE.is_file()
    with TABLE.open("a", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        if new:
            writer.writerow(COLUMNS)
        for scene, spp in product(scenes, COUNTS):
            sequence = CACHE / scene / f"{spp}-0.exr"
            if (scene, str(spp)) in done or not sequence.is_file():
                continue
            rows = [[scene, spp, *row] for row in measured(sequence)]
            for _, _, experts, method, *errors in rows:
                known = told[scene, spp].get(f"{method} {experts}".strip())
                if known and not all(
                    math.isclose(*pair, rel_tol=CLOSE) for pair in zip(errors, known, strict=True)
                ):
                    print(f"{scene}, {spp} spp, {method} {experts}: {errors}, not {known}", file=sys.stderr)
            writer.writerows([*row[:4], *(f"{error:.6g}" for error in row[4:])] for row in rows)
            file.flush()
            print(f"{scene}, {spp} spp", flush=True)


def measured(sequence: Path) -> Iterator[list]:
    """Experts, method and errors."""
    import numpy as np
    from neighbours_make import layers, stacked
    from oracle_weights import forms

    truth = np.stack([np.moveaxis(half, -1, 0) for half in halves(sequence.parent.name)])
    channels = layers(sequence)
    yield ["", PLAIN, *forms.errors(np.moveaxis(stacked(channels), -1, 0), truth)]
    emits = np.zeros(truth.shape[2:], bool)
    for name, pixels in channels.items():
        emits |= name.startswith("emission.") & (pixels != 0)
    for experts in LISTS:
        table, emission = of_layers = tables(sequence, experts)
        other = tables(sequence.with_name(sequence.name.replace("-0", "-1")), experts)
        closed = forms.blended(table.closed.mean(axis=3, dtype="f8"), table)
        yield [experts, CLOSED, *forms.errors(closed, truth)]
        yield [experts, AT_LAMPS, *forms.errors(np.where(emits, closed, truth[0]), truth)]
        for metric, name in enumerate(METRICS):
            for kind, found in {
                **by_what_is_near(of_layers, other, truth, metric),
                **by_descent(table, emission, truth, metric),
            }.items():
                yield [experts, f"{kind} {name}", *found]


def tables(sequence: Path, experts: str) -> tuple:
    """Of the reflected layer, and of emission, if there is any."""
    from oracle_emission import emitted

    from nst_train.guard_training.make import look

    with tempfile.TemporaryDirectory() as folder:
        table = look(sequence, experts, Path(folder) / "guard.safetensors")
    return table, emitted(sequence, table)


def by_what_is_near(of_layers: tuple, other: tuple, truth: "np.ndarray", metric: int) -> dict:
    """Errors of kinds of weights that follow from sums; also of another rendering of the scene."""
    from oracle_weights import by_sums, forms

    table, _ = of_layers
    kinds = {kind: forms.blended(w, table) for kind, w in by_sums(table, truth, metric).items()}
    for kind, fitted in {"both": of_layers, "other": other}.items():
        kinds[kind] = blended(of_layers, near_both(fitted, truth, metric))
    return {kind: list(forms.errors(t, truth)) for kind, t in kinds.items()}


def near_both(of_layers: tuple, truth: "np.ndarray", metric: int) -> list:
    """Weights by what is near in both layers: those of emission after those of the reflected one, as the
    reference does not tell them apart."""
    from oracle_weights import by_sums

    table, emission = of_layers
    weights = [by_sums(table, truth, metric)["near"]]
    if emission:
        lit = replace(emission, rest=blended(of_layers, weights))
        weights.append(by_sums(lit, truth, metric)["near"])
    return weights


def blended(of_layers: tuple, weights: list) -> "np.ndarray":
    """T by the weights of one layer, or both; of emission, S stays where it has none."""
    from oracle_weights import forms

    table, emission = of_layers
    if not emission:
        return forms.blended(weights[0], table)
    t = forms.blended(weights[0], replace(table, rest=emission.rest))
    return t if len(weights) == 1 else forms.blended(weights[1], replace(emission, rest=t))


def by_descent(table, emission, truth: "np.ndarray", metric: int) -> dict:
    """Errors of the best weights."""
    import numpy as np
    from oracle_weights import Layer, best, by_sums, forms

    def of_both(known: np.ndarray) -> np.ndarray:
        """T of the best weights of both layers, as far as this is known."""
        of_layers = [Layer(table, by_sums(table, known, metric)["near"])]
        if emission:
            of_layers.append(Layer(emission, emission.closed.mean(axis=3)))
        return best(emission.rest if emission else table.rest, of_layers, known, metric)

    start = by_sums(table, truth, metric)["near"]
    kinds = {"surfaces": best(table.rest, [Layer(table, start)], truth, metric), "best": of_both(truth)}
    errors = {kind: list(forms.errors(t, truth)) for kind, t in kinds.items()}
    of_halves = []
    for own, other in (truth, truth[::-1]):
        squares = (of_both(np.stack([own, own])) - other) ** 2
        of_half = (forms.importance(truth) * squares).reshape(len(METRICS), -1).mean(axis=1)
        of_halves.append(of_half - 2 * forms.noise(truth))
    return {**errors, "half": list(np.mean(of_halves, axis=0))}


Errors = dict[tuple[str, int], dict[str, list[float]]]


def add(errors: Errors, row: dict[str, str], method: str) -> None:
    of = errors.setdefault((row["scene"], int(row["spp"])), {})
    of[method] = [float(row[metric]) for metric in METRICS]


def guards() -> Errors:
    """What docs/learned-guard.csv says of run 0, by picture and method with experts."""
    errors: Errors = {}
    for row in read(GUARDS):
        if (row["set"], row["run"]) == ("scenes", "0"):
            add(errors, row, row["method"])
    return errors


def all_errors() -> Errors:
    """Of all methods with their experts, of pictures that are measured."""
    errors: Errors = {}
    for row in read(TABLE):
        add(errors, row, f"{row['method']} {row['experts']}".strip())
    for picture, of in guards().items():
        if picture in errors:
            errors[picture] = of | errors[picture]
    return errors


def ratios(errors: Errors, method: str, to: tuple[str, ...], spp: int | None = None) -> list[list[float]]:
    """To the least of these methods, `[metric][picture]`."""
    return [
        [
            max(of[method][m] / min(of[other][m] for other in to), LEAST)
            for picture, of in errors.items()
            if spp in (None, picture[1])
        ]
        for m in range(len(METRICS))
    ]


def means(errors: Errors, method: str, to: tuple[str, ...], spp: int | None = None) -> list[float]:
    return [geometric_mean(values) for values in ratios(errors, method, to, spp)]


def summary(errors: Errors) -> list[str]:
    """Geometric means, the largest, and the share of ln(T/S) that the guards reach."""
    heads = ["experts", "weights", "T/min(S, OIDN)", "the best for relMSE", "the largest", "T/S at 32 spp"]
    heads += [f"of the gain, the {name} has" for name in GUARD_NAMES.values()]
    lines = [cells(heads), "|---" * len(heads) + "|"]
    for experts in LISTS:
        for guard, name in GUARD_NAMES.items():
            method = f"{guard} {experts}"
            found = both(means(errors, method, (PLAIN, OIDN)))
            row = [f"`{experts}`", name, found, "–", *of_each(errors, [method] * len(METRICS))]
            lines.append(cells([*row, *("–" for _ in GUARD_NAMES)]))
        for kind, name in KINDS.items():
            of = [f"{kind} {metric} {experts}" for metric in METRICS]
            found = [both(means(errors, method, (PLAIN, OIDN))) for method in of]
            shares = [
                " / ".join(
                    f"{100 * share(errors, f'{guard} {experts}', of, m):.0f} %" for m in range(len(of))
                )
                for guard in GUARD_NAMES
            ]
            lines.append(cells([f"`{experts}`", name, *found, *of_each(errors, of), *shares]))
    return lines


def of_each(errors: Errors, methods: list[str]) -> list[str]:
    """The largest T/min(S, OIDN), and the mean T/S at 32 spp, with a method for each metric."""
    largest = [max(ratios(errors, method, (PLAIN, OIDN))[m]) for m, method in enumerate(methods)]
    at_32 = [means(errors, method, (PLAIN,), 32)[m] for m, method in enumerate(methods)]
    return [both(largest), both(at_32)]


def share(errors: Errors, guard: str, oracles: list[str], metric: int) -> float:
    """Of what the weights gain over S that are the best for a metric, in its logarithm."""
    of_both = [means(errors, method, (PLAIN,))[metric] for method in (guard, oracles[metric])]
    return math.log(of_both[0]) / math.log(of_both[1])


def farthest(errors: Errors) -> list[str]:
    """The pictures in which the network's errors are the most times those by the other rendering's truth."""
    heads = [
        "experts",
        *(f"where the network has the most times their {label}" for label in ("MSE", "relMSE")),
    ]
    lines = [cells(heads), "|---" * len(heads) + "|"]
    for experts in LISTS:
        of_metrics = []
        for m, metric in enumerate(METRICS):
            found = [
                (of[f"learned {experts}"][m] / of[f"other {metric} {experts}"][m], picture)
                for picture, of in errors.items()
            ]
            worst = sorted(found, reverse=True)[:SHOWN]
            of_metrics.append("; ".join(f"`{scene}` {spp} spp: {x:.2f}" for x, (scene, spp) in worst))
        lines.append(cells([f"`{experts}`", *of_metrics]))
    return lines


def blocks() -> dict[str, list[str]]:
    errors = all_errors()
    return {
        "oracle": summary(errors),
        "oracle farthest": farthest(errors),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--measure", nargs="*", metavar="SCENE", choices=[*SCENES["test"], []])
    args = parser.parse_args()
    if args.measure is not None:
        measure(args.measure or SCENES["test"])
        return 0
    return fill(PAGE, blocks(), __file__, args.check)


if __name__ == "__main__":
    sys.exit(main())
