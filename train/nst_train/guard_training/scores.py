"""What weights do to pictures of families that are held out, exactly, pixel by pixel."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from nst_train.errors import UserError
from nst_train.guard_training import forms, stored
from nst_train.guard_training.data import best, can_tell, taking_part
from nst_train.guard_training.settings import Settings
from nst_train.guard_training.stored import LISTS, Rows
from nst_train.guard_training.table import Table
from nst_train.model import GuardMlp

CLOSED = "closed"
"""The method that is the closed form."""
MOST_NOISE = 0.1
"""Of a reference, as a share of S's errors: pictures with more are not judged."""
LEAST = 1e-3
"""Ratios of errors count as no less: with the references' noise, one can even be negative."""
COLUMNS = [
    "scene",
    "family",
    "spp",
    "experts",
    "method",
    "mse_to_s",
    "relmse_to_s",
    "mse_to_min",
    "relmse_to_min",
]


@dataclass(frozen=True)
class Score:
    """Of one method in one picture, with one list of experts."""

    scene: str
    family: str
    spp: int
    experts: str
    method: str
    to_plain: np.ndarray  # [metric]: the error over that of S
    to_best: np.ndarray  # [metric]: over that of S or the denoiser, whichever is less

    def row(self) -> list[object]:
        """In the order of `COLUMNS`."""
        numbers = [float(x) for x in (*self.to_plain, *self.to_best)]
        return [self.scene, self.family, self.spp, self.experts, self.method, *numbers]


def score(models: dict[str, GuardMlp], folder: Path, settings: Settings) -> list[Score]:
    """The closed form's scores, and those of networks by name."""
    scores = []
    for path in stored.files(folder, held_out=True):
        picture, tables, halves = stored.read_with_pixels(path)
        if not can_tell(picture, MOST_NOISE):
            continue
        for rows, table in zip(picture.lists, tables, strict=True):
            errors = {CLOSED: rows.closed_errors}
            for name, model in models.items():
                t = forms.blended(weights_in_cells(model, rows, table), table)
                errors[name] = forms.errors(t, halves)
            about = (picture.scene, picture.family, picture.spp, rows.experts)
            for method, found in errors.items():
                to_best = found / best(picture, settings)
                scores.append(Score(*about, method, found / picture.plain, to_best))
    if not scores:
        raise UserError(f"{folder}: the references of all held-out pictures have too much noise for scores")
    return scores


@torch.no_grad()
def weights_in_cells(model: GuardMlp, rows: Rows, table: Table) -> np.ndarray:
    """`[cell's row, cell's column, knot, expert]`, of the table's experts."""
    part = taking_part(rows.experts)
    found = model.weights(torch.from_numpy(rows.inputs), torch.from_numpy(rows.closed), part)
    cells = np.zeros((*table.grid, len(table.experts)))
    cells[tuple(rows.where.T)] = found.mean(dim=1).numpy()[:, table.slots]
    return cells


def summary(scores: list[Score], experts: str, method: str) -> list[float]:
    """Over pictures: geometric means of T/min and T/S, the worst of both; each in both metrics."""
    chosen = [s for s in scores if (s.experts, s.method) == (experts, method)]
    found = []
    for ratios in (np.stack([s.to_best for s in chosen]), np.stack([s.to_plain for s in chosen])):
        means = np.exp(np.log(np.maximum(ratios, LEAST)).mean(axis=0))
        found.append((means, ratios.max(axis=0)))
    (of_best, worst_best), (of_plain, worst_plain) = found
    return [float(x) for x in (*of_best, *of_plain, *worst_plain, *worst_best)]


def methods(scores: Iterable[Score]) -> list[str]:
    return list(dict.fromkeys(s.method for s in scores))


def lines(scores: list[Score]) -> list[str]:
    """A table to print, by list of experts, method, and samples per pixel."""
    heads = ("T/min", "T/S", "worst T/S", "worst T/min")
    found = [
        "on held-out families, in MSE / relMSE; min is the error of S or of the denoiser, whichever is less",
        f"{'experts':<18} {'spp':>9} {'pictures':>8} {'method':>9}"
        + "".join(f"{head:>16}" for head in heads),
    ]
    strata = [(2, 2**30), *((n, 4 * n - 1) for n in (8, 32, 128, 512))]
    for experts in LISTS:
        for low, high in strata:
            part = [s for s in scores if s.experts == experts and low <= s.spp <= high]
            for method in methods(part):
                count = sum(s.method == method for s in part)
                numbers = summary(part, experts, method)
                pairs = (f"{a:.3f} / {b:.3f}" for a, b in zip(numbers[::2], numbers[1::2], strict=True))
                name = "all" if low == 2 else f"{low}–{high}"
                cells = "".join(f"{pair:>16}" for pair in pairs)
                found.append(f"{experts:<18} {name:>9} {count:>8} {method:>9}{cells}")
    return found
