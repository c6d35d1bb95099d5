"""Stored pictures as a network is trained on them. Held-out ones are in another folder, and not opened."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from nst_train.errors import UserError
from nst_train.guard_training import stored
from nst_train.guard_training.settings import Settings
from nst_train.guard_training.stored import Stored
from nst_train.guard_training.table import EXPERTS

SPREAD_FLOOR = 0.01
"""Added to the standard deviation of an input, which may be 0."""
EVERY = 7
"""Of so many rows, one tells of the inputs' means and deviations."""


@dataclass(frozen=True)
class Item:
    """A picture with one list of experts. Errors are in units of the best one, `best`, in each metric."""

    scene: str
    family: str
    spp: int
    inputs: Tensor  # [row, half, input]
    closed: Tensor  # [row, half, expert]
    part: Tensor  # [expert]: whether it takes part
    forms: Tensor  # [row, metric, form]
    constant: Tensor  # [metric]
    plain: Tensor  # [metric], of S
    closed_errors: Tensor  # [metric]


def load(folder: Path, settings: Settings) -> list[Item]:
    """All items of the families that are trained on."""
    pictures = [stored.read(path) for path in stored.files(folder, held_out=False)]
    items = [item for picture in pictures for item in items_of(picture, settings)]
    if not items:
        raise UserError(f"{folder}: the references of all pictures have too much noise to learn from")
    return items


def scenes_of(items: list[Item]) -> list[str]:
    return list(dict.fromkeys(item.scene for item in items))


def items_of(picture: Stored, settings: Settings) -> list[Item]:
    """One for each list of experts; none, if the reference has too much noise."""
    if not can_tell(picture, settings.most_noise):
        return []
    unit = best(picture, settings)
    items = []
    for rows in picture.lists:
        used = rows.forms.any(axis=(1, 2))  # those of neighbouring cells count in exact errors alone
        items.append(
            Item(
                picture.scene,
                picture.family,
                picture.spp,
                inputs=torch.from_numpy(rows.inputs[used]),
                closed=torch.from_numpy(rows.closed[used]),
                part=taking_part(rows.experts),
                forms=torch.from_numpy((rows.forms[used] / unit[:, None]).astype(np.float32)),
                constant=of_errors(rows.constant / unit),
                plain=of_errors(picture.plain / unit),
                closed_errors=of_errors(rows.closed_errors / unit),
            )
        )
    return items


def can_tell(picture: Stored, most_noise: float) -> bool:
    """Whether the references have no more noise than this share of S's errors."""
    return bool((picture.plain > 0).all() and (picture.noise <= most_noise * picture.plain).all())


def best(picture: Stored, settings: Settings) -> np.ndarray:
    """`[metric]`: the errors of S or of the denoiser, whichever has less; but not less than a share of S's,
    as references have noise and nobody needs more."""
    return np.maximum(np.minimum(picture.plain, picture.denoiser), settings.loss.least * picture.plain)


def taking_part(experts: str) -> Tensor:
    return torch.tensor([name in experts.split(",") for name in EXPERTS])


def of_errors(values: np.ndarray) -> Tensor:
    return torch.from_numpy(values.astype(np.float32))


def normalisation(items: list[Item]) -> tuple[Tensor, Tensor]:
    """Mean and spread of each input, `[input]`."""
    seen = torch.cat([item.inputs[::EVERY].flatten(0, 1) for item in items]).double()
    return seen.mean(dim=0), seen.std(dim=0, correction=0) + SPREAD_FLOOR
