"""Measures the learned guard beside the closed form, for docs/learned-guard.md.

    "$(tools/python-env docs/requirements-neighbours.txt)" docs/learned_guard.py --measure FOLDER
    python docs/learned_guard.py            # writes the tables into the page
    python docs/learned_guard.py --check    # compares instead; exit code 1 on a difference

FOLDER is what `python -m nst_train guard-data --folder FOLDER` (train/README.md) has made; of it, families
that are held out of training are measured. The fifteen scenes of docs/neighbours.py must have been made, too.
`--measure` uses target/release/nst, or the binary that the environment variable NST names, and goes on where
it was cut off. docs/learned-guard.csv has a row for each picture and method, with errors as in
docs/neighbours.csv; docs/learned-guard-curve.csv is what `nst_train guard --curve` writes, and
docs/learned-guard-ablations.csv what its `--ablations` does.
"""

import csv
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from pathlib import Path
from statistics import geometric_mean

import neighbours
from neighbours import (
    CACHE,
    COUNTS,
    DOCS,
    METRICS,
    OIDN,
    PLAIN,
    PREDICTED,
    RUNS,
    SCENES,
    both,
    cells,
    errors,
    read,
)
from neighbours_random import is_noisy
from page import command

PAGE = DOCS / "learned-guard.md"
TABLE = DOCS / "learned-guard.csv"
CURVE = DOCS / "learned-guard-curve.csv"
ABLATIONS = DOCS / "learned-guard-ablations.csv"
COLUMNS = ["set", "scene", "spp", "run", "method", *METRICS, *PREDICTED]
LISTS = ["lane,filter,oidn", "lane,filter"]
GUARDS = ["closed", "learned"]
METHODS = {
    f"{guard} {experts}": ["--transform", "auto", "--experts", experts, "--guard", guard]
    for experts, guard in product(LISTS, GUARDS)
}
SETS = {"scenes": "the fifteen scenes", "held out": "held-out families"}
# Where T counts as harm.
LIMIT = 1.01
# A part of a picture's error in the geometric mean: one that is estimated without bias may be below 0.
LEAST = 1e-4


@dataclass(frozen=True)
class Sequence:
    """A picture that is measured."""

    group: str
    scene: str
    spp: int
    run: int
    path: Path
    references: list[Path]

    def key(self, method: str) -> tuple[str, ...]:
        return (self.group, self.scene, str(self.spp), str(self.run), method)


def sequences(folder: Path) -> Iterator[Sequence]:
    for scene, spp, run in product(SCENES["test"], COUNTS, range(RUNS)):
        references = [CACHE / scene / f"reference-{i}.exr" for i in (0, 1)]
        yield Sequence("scenes", scene, spp, run, CACHE / scene / f"{spp}-{run}.exr", references)
    sys.path.append(str(DOCS.parent / "train"))
    from nst_train.guard_data.read import pictures

    for picture in pictures(folder):
        if picture.held_out:
            references = list(picture.references)
            yield Sequence("held out", picture.scene, picture.spp, 0, picture.sequence, references)


def measure(folder: Path) -> None:
    from neighbours_make import layers, stacked

    neighbours.METHODS.update(METHODS)
    done = {tuple(row[name] for name in COLUMNS[:5]) for row in read(TABLE)}
    new = not TABLE.is_file()
    with TABLE.open("a", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        if new:
            writer.writerow(COLUMNS)
        for sequence in sequences(folder):
            methods = [PLAIN, OIDN, *METHODS]
            if not sequence.path.is_file() or sequence.key(methods[-1]) in done:
                continue
            halves = [stacked(layers(path)).astype("f8") for path in sequence.references]
            plain = errors(stacked(layers(sequence.path)), halves)
            # Those of the fifteen scenes are rendered with more samples, for docs/neighbours.csv, too.
            if sequence.group != "scenes" and is_noisy(halves, plain):
                continue
            rows = []
            for method in methods:
                colors, predicted = estimated(sequence.path, method)
                values = [*errors(colors, halves), *map(predicted.get, PREDICTED)]
                texts = ["" if value is None else f"{value:.6g}" for value in values]
                rows.append([*sequence.key(method), *texts])
            writer.writerows(rows)
            file.flush()


def estimated(path: Path, method: str):
    """Those of neighbours.py; the denoiser alone gets those features that there are."""
    if method != OIDN:
        return neighbours.estimated(path, method)
    import numpy as np
    import pyoidn
    from neighbours_make import layers, stacked

    channels = layers(path)
    guides = [np.clip(stacked(channels, "albedo"), 0, 1)] if "albedo.R" in channels else []
    # It takes normals beside albedo alone.
    guides += [stacked(channels, "normal", "XYZ")] if guides and "normal.X" in channels else []
    return pyoidn.denoise(stacked(channels), *guides, hdr=True), {}


@dataclass(frozen=True)
class Ratios:
    """Of one method, `[metric][picture]`."""

    to_s: list[list[float]]
    to_min: list[list[float]]

    def mean(self, name: str) -> list[float]:
        return [geometric_mean(max(x, LEAST) for x in values) for values in getattr(self, name)]

    def worst(self, name: str) -> list[float]:
        return [max(values) for values in getattr(self, name)]


Errors = dict[tuple[str, ...], dict[str, list[float]]]


def by_picture(rows: list[dict[str, str]]) -> Errors:
    """Means over runs, by set, scene and spp, then by method."""
    sums: Errors = {}
    for row in rows:
        of = sums.setdefault((row["set"], row["scene"], row["spp"]), {}).setdefault(row["method"], [0.0, 0.0])
        of[:] = [total + float(row[metric]) for total, metric in zip(of, METRICS, strict=True)]
    return sums  # sums over as many runs for each method: ratios are those of means


def ratios(pictures: Errors, group: str | None, method: str, spp: str | None = None) -> Ratios:
    chosen = [of for key, of in pictures.items() if group in (None, key[0]) and spp in (None, key[2])]
    metrics = range(len(METRICS))
    best = [[min(of[PLAIN][m], of[OIDN][m]) for of in chosen] for m in metrics]
    return Ratios(
        [[of[method][m] / of[PLAIN][m] for of in chosen] for m in metrics],
        [[of[method][m] / least for of, least in zip(chosen, best[m], strict=True)] for m in metrics],
    )


def summary(pictures: Errors) -> list[str]:
    head = ["pictures", "experts", "guard", "T/S", "largest", "above 1.01", "T/min(S, OIDN)", "largest"]
    lines = [cells(head), "|---" * len(head) + "|"]
    for group, experts, guard in product(SETS, LISTS, GUARDS):
        found = ratios(pictures, group, f"{guard} {experts}")
        above = " / ".join(str(sum(x > LIMIT for x in values)) for values in found.to_s)
        count = len(found.to_s[0])
        of_s = [both(found.mean("to_s")), both(found.worst("to_s")), above]
        of_min = [both(found.mean("to_min")), both(found.worst("to_min"))]
        lines.append(cells([f"{count}, {SETS[group]}", f"`{experts}`", guard, *of_s, *of_min]))
    return lines


def overall(pictures: Errors) -> list[str]:
    """T/min of the network over all pictures, and its errors over those of the closed form."""
    heads = [
        "experts",
        "pictures",
        "T/min(S, OIDN)",
        *(f"over the closed form, {name}" for name in ["all", *SETS.values()]),
    ]
    lines = [cells([*heads, f"above {LIMIT}", "largest"]), "|---" * (len(heads) + 2) + "|"]
    for experts in LISTS:
        closed, learned = (f"{guard} {experts}" for guard in GUARDS)
        all_of_them = ratios(pictures, None, learned)
        means, beside = [], []
        for group in (None, *SETS):
            of_both = [ratios(pictures, group, method).to_s for method in (learned, closed)]
            beside.append(
                [[t / c for t, c in zip(*pair, strict=True)] for pair in zip(*of_both, strict=True)]
            )
            means.append(both([geometric_mean(values) for values in beside[-1]]))
        above = sum(max(pair) > LIMIT for pair in zip(*beside[0], strict=True))
        largest = both([max(values) for values in beside[0]])
        count = len(all_of_them.to_min[0])
        lines.append(
            cells([f"`{experts}`", str(count), both(all_of_them.mean("to_min")), *means, str(above), largest])
        )
    return lines


def by_samples(pictures: Errors) -> list[str]:
    """T/min of the closed form, then of the network."""
    counts = [str(count) for count in COUNTS]
    lines = [cells(["pictures", "experts", *(f"{count} spp" for count in counts)])]
    lines.append("|---" * (2 + len(counts)) + "|")
    for group, experts in product(SETS, LISTS):
        values = []
        for count in counts:
            methods = [f"{guard} {experts}" for guard in GUARDS]
            closed, learned = (ratios(pictures, group, method, count) for method in methods)
            known = bool(closed.to_s[0])
            values.append(f"{both(closed.mean('to_min'))} → {both(learned.mean('to_min'))}" if known else "–")
        lines.append(cells([SETS[group], f"`{experts}`", *values]))
    return lines


def told(rows: list[dict[str, str]]) -> list[str]:
    """In how many renderings the interval of the prediction contains the true MSE ratio."""
    lines = [cells(["pictures", "method", "renderings", "inside"]), "|---" * 4 + "|"]
    plain = {tuple(row[name] for name in COLUMNS[:4]): row for row in rows if row["method"] == PLAIN}
    for group, method in product(SETS, METHODS):
        own = [row for row in rows if row["set"] == group and row["method"] == method]
        inside = 0
        for row in own:
            true = float(row["mse"]) / float(plain[tuple(row[name] for name in COLUMNS[:4])]["mse"])
            inside += float(row["predicted_low"]) <= true <= float(row["predicted_high"])
        lines.append(cells([SETS[group], f"`{method}`", str(len(own)), f"{100 * inside / len(own):.1f} %"]))
    return lines


def curve() -> list[str]:
    lines = [cells(["experts", "trained on", "T/min(S, OIDN)", "largest"]), "|---" * 4 + "|"]
    for row in read(CURVE):
        network = row["method"] == "network"
        name = f"{row['scenes']} scenes, {row['pictures']} pictures" if network else "nothing (closed form)"
        mean = both([float(row["mse_to_min"]), float(row["relmse_to_min"])])
        worst = both([float(row["worst_mse_to_min"]), float(row["worst_relmse_to_min"])])
        lines.append(cells([f"`{row['experts']}`", name, mean, worst]))
    return lines


def ablations() -> list[str]:
    """T/min(S, OIDN) of each network, by list of experts."""
    rows = read(ABLATIONS)
    lists = list(dict.fromkeys(row["experts"] for row in rows))
    heads = [head for experts in lists for head in (f"`{experts}`", "largest")]
    lines = [cells(["network", "parameters", *heads]), "|---" * (2 + len(heads)) + "|"]
    for first in rows:
        if first["experts"] != lists[0]:
            continue
        own = [row for row in rows if row["network"] == first["network"]]
        pairs = [(f"{head}mse_to_min", f"{head}relmse_to_min") for head in ("", "worst_")]
        found = [both([float(row[name]) for name in pair]) for row in own for pair in pairs]
        closed = first["network"] == "closed"
        name = "none (closed form)" if closed else first["network"]
        lines.append(cells([name, "–" if closed else first["parameters"], *found]))
    return lines


def blocks() -> dict[str, list[str]]:
    rows = read(TABLE)
    pictures = by_picture(rows)
    return {
        "summary": summary(pictures),
        "overall": overall(pictures),
        "by samples": by_samples(pictures),
        "told": told(rows),
        "curve": curve(),
        "ablations": ablations(),
    }


def main(argv: list[str]) -> int:
    return command(argv, __file__, __doc__, PAGE, measure, blocks)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
