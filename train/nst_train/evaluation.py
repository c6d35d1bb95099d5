"""Scores on sequences that were not trained on."""

import csv
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from nst_train.model import Mlp
from nst_train.sequences import Data

REPORTED_N = (8, 16, 32, 64)


@dataclass(frozen=True)
class Score:
    """How T_n compares with S_n; a ratio below 1 is a gain."""

    data: str
    n: int
    mse_ratio: float  # E[(T−I)²] / E[(S−I)²], over all runs and integrands
    constant_mse_ratio: float  # the same, for T = the mean of I over the training integrands


def evaluate(model: Mlp, data: Data) -> list[Score]:
    """Scores at 8, 16, 32, 64 samples and at the last term, for each held-out set."""
    constant = data.training.reference.mean()
    scores = []
    for name, held_out in data.held_out.items():
        terms = held_out.estimates.shape[-1]
        reported = {n for n in REPORTED_N if model.window <= n <= terms} | {terms}
        for n in sorted(reported):
            window = held_out.estimates[:, :, n - model.window : n]
            with torch.no_grad():
                t = model(window)
            s = window[:, :, -1]
            mse_s = mean_squared_error(s, held_out.reference)
            mse_t = mean_squared_error(t, held_out.reference)
            mse_constant = mean_squared_error(constant.expand_as(s), held_out.reference)
            scores.append(Score(name, n, mse_t / mse_s, mse_constant / mse_s))
    return scores


def mean_squared_error(estimates: Tensor, reference: Tensor) -> float:
    """The mean over integrands and runs of `[integrand, run]`, in f64."""
    return (estimates.double() - reference.double()[:, None]).square().mean().item()


def write_metrics(path: Path, name: str, scores: list[Score], train_loss: float) -> None:
    """One row per score; `train_loss` is that of the last epoch."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["name", "data", "n", "mse_ratio", "constant_mse_ratio", "train_loss"])
        for score in scores:
            ratios = (f"{score.mse_ratio:.6g}", f"{score.constant_mse_ratio:.6g}")
            writer.writerow([name, score.data, score.n, *ratios, f"{train_loss:.6g}"])
