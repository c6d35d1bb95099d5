"""A run's checkpoint and its history, from which an interrupted run is continued."""

import os
from pathlib import Path
from typing import Any

import torch

from nst_train import evaluation
from nst_train.errors import UserError
from nst_train.training import Descent

FORMAT = "nst-checkpoint-1"


def save(out: Path, training: Descent, trained_on: str, seconds_at: list[float]) -> None:
    """The checkpoint and the history so far."""
    state = training.state() | {
        "format": FORMAT,
        "trained_on": trained_on,
        "seconds_at": seconds_at,
    }
    path = out / "checkpoint.pt"
    unfinished = path.with_name(path.name + ".part")
    torch.save(state, unfinished)
    os.replace(unfinished, path)
    write_history(out, training.losses, seconds_at)


def resume(out: Path, training: Descent, trained_on: str) -> list[float]:
    """Continues from the folder's checkpoint, if there is one; returns its `seconds_at`."""
    path = out / "checkpoint.pt"
    if not path.is_file():
        return []
    damaged = UserError(f"{path}: not a checkpoint, or a damaged one; delete it to start again")
    try:
        state: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # of many kinds: the unpickler takes the file for a program
        raise damaged from error
    if not isinstance(state, dict) or state.get("format") != FORMAT:
        raise damaged
    if state["trained_on"] != trained_on:
        raise UserError(
            f"{path}: it was trained on {state['trained_on']}, but the data are now {trained_on}; "
            "delete it to start again"
        )
    try:
        training.restore(state)
        seconds_at: list[float] = state["seconds_at"]
        write_history(out, training.losses, seconds_at)
    except (AttributeError, KeyError, TypeError, ValueError, RuntimeError) as error:
        raise damaged from error
    print(f"going on after epoch {training.epoch} of {path}", flush=True)
    return seconds_at


def write_history(out: Path, losses: list[float], seconds_at: list[float]) -> None:
    """history.csv: the loss of each epoch, and the seconds of training up to its end."""
    rows = zip(range(1, len(losses) + 1), losses, seconds_at, strict=True)
    evaluation.write_csv(out / "history.csv", evaluation.HISTORY_COLUMNS, rows)
