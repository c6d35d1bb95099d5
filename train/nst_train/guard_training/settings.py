"""The config of a network that corrects the guard's weights: a TOML file whose keys are all required."""

import math
import re
import tomllib
from dataclasses import dataclass
from pathlib import Path

from nst_train.config import read_table
from nst_train.errors import UserError


@dataclass(frozen=True)
class Loss:
    """See `descent.py`."""

    least: float  # of the best error, as a share of S's
    floor: float  # added to ratios of errors before their logarithm
    harm: float  # how much more a picture counts, by ln, that has more error than S
    regret: float  # the same, than the closed form or S
    regret_floor: float  # added to both of these errors


@dataclass(frozen=True)
class Settings:
    name: str
    seed: int  # of the initial weights, and of the order of pictures
    hidden: list[int]
    prior_floor: float  # added to the closed form's weights before their logarithm
    steps: int
    batch_size: int  # pictures, each with one list of experts
    learning_rate: float  # the largest; it rises and falls (OneCycleLR)
    weight_decay: float
    gradient_norm: float  # gradients are scaled down to it
    start: float  # what the last layer's initial weights are multiplied by
    most_noise: float  # of a reference, as a share of S's error: of pictures with more, nothing is learnt
    loss: Loss
    text: str  # the file itself


def load(path: Path) -> Settings:
    """Reads and checks a config."""
    try:
        text = path.read_text(encoding="utf-8")
        return parse(tomllib.loads(text), text)
    except OSError as error:
        raise UserError(f"{path}: cannot read the config: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UserError(f"{path}: not a TOML file: {error}") from error
    except UserError as error:
        raise UserError(f"{path}: {error}") from error


def parse(table: dict, text: str) -> Settings:
    """Checks a parsed TOML table; `text` is the file that it came from."""
    of_loss = table.get("loss")
    if not isinstance(of_loss, dict):
        raise UserError("missing table [loss]")
    loss = read_table(Loss, of_loss, "loss.")
    settings = read_table(Settings, table, "", loss=loss, text=text)
    positive = ("prior_floor", "learning_rate", "gradient_norm", "start", "most_noise")
    rules = [
        ("name", re.fullmatch(r"[\w-]+", settings.name) is not None, "letters, digits, '-' or '_'"),
        ("seed", 0 <= settings.seed < 2**63, "0 or more, below 2^63"),
        ("hidden", bool(settings.hidden) and min(settings.hidden) >= 1, "a list of widths, each 1 or more"),
        ("steps", settings.steps >= 2, "2 or more"),
        ("batch_size", settings.batch_size >= 1, "1 or more"),
        ("weight_decay", 0 <= settings.weight_decay < math.inf, "0 or more"),
        *((key, 0 < getattr(settings, key) < math.inf, "a positive number") for key in positive),
    ]
    for key, holds, requirement in rules:
        if not holds:
            raise UserError(f"{key} = {getattr(settings, key)!r}: must be {requirement}")
    for key, value in vars(loss).items():
        floor = key in ("least", "floor", "regret_floor")
        if not 0 <= value < math.inf or (floor and value == 0):
            raise UserError(
                f"loss.{key} = {value!r}: must be {'a positive number' if floor else '0 or more'}"
            )
    return settings
