"""Scores on sequences that were not trained on: metrics.csv."""

import csv
import os
from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from nst_train import analytic, bayes, families, scene_evaluation
from nst_train.config import Config, FamiliesData
from nst_train.model import Mlp, SampleMlp
from nst_train.scene_renders import SceneData, counts
from nst_train.sequences import Data, Sequences

REPORTED_N = (8, 16, 32, 64)
"""The n of tables."""

BAYES_N = (8, 11, 16, 23, 32, 45, 64)
"""The n at which the Bayes limit is computed: it is slow, and this is enough for a curve."""

CHUNK = 1 << 18
"""Windows that go through the network at a time, to save memory."""


@dataclass(frozen=True)
class Score:
    """The error of a method at n samples, over all runs and integrands of a held-out set."""

    name: str  # of the network, which says what the constant is a mean of
    data: str  # which held-out set
    method: str  # S, T, constant, bayes, or one of analytic.METHODS
    n: int
    mse: float  # mean (x − I)², equations 3 and 4
    bias2: float  # mean over integrands of (mean over runs of x − I)²; includes variance/runs
    variance: float  # the rest of mse
    mse_ratio: float  # mse over that of S


COLUMNS = [field.name for field in fields(Score)]
HISTORY_COLUMNS = ["epoch", "loss", "seconds"]


def evaluate(config: Config, model: Mlp, data: Data | SceneData) -> list[Score]:
    """All scores of a trained network, and of the methods that it is compared with."""
    if isinstance(data, SceneData):
        return network_scores(config, model, data, every_n(config, data))
    scores = network_scores(config, model, data, every_n(config, data))
    constant = data.training.reference.double().mean().numpy()
    for name, held_out in data.held_out.items():
        reference = held_out.reference.double().numpy()
        estimates = held_out.estimates.numpy()
        tables = {"constant": dict.fromkeys(every_n(config, data), constant)}
        for method, (length, _) in analytic.METHODS.items():
            tables[method] = {
                n: analytic.transform(method, estimates, n) for n in every_n(config, data) if n >= length
            }
        if isinstance(config.data, FamiliesData):
            tables["bayes"] = bayes_limits(config, name, every_n(config, data))
        for method, table in tables.items():
            for n, values in table.items():
                mse_s = errors(estimates[..., n - 1], reference)[0]
                error = errors(np.broadcast_to(values, estimates.shape[:-1]), reference)
                scores.append(Score(config.name, name, method, n, *error, error[0] / mse_s))
    return scores


def every_n(config: Config, data: Data | SceneData) -> Sequence[int]:
    """All n at which the network has its window, or the scenes have pictures."""
    if isinstance(data, SceneData):
        return counts(config.data.terms)
    return range(config.window, data.training.estimates.shape[-1] + 1)


def network_scores(config: Config, model: Mlp, data: Data | SceneData, ns: Iterable[int]) -> list[Score]:
    """S and T alone."""
    if isinstance(data, SceneData):
        return scene_scores(config, model, data, ns)
    scores = []
    for name, held_out in data.held_out.items():
        reference = held_out.reference.double().numpy()
        for n in ns:
            s = errors(held_out.estimates[:, :, n - 1].numpy(), reference)
            t = errors(transformed(model, held_out, n).numpy(), reference)
            for method, error in (("S", s), ("T", t)):
                scores.append(Score(config.name, name, method, n, *error, error[0] / s[0]))
    return scores


def scene_scores(config: Config, model: Mlp, data: SceneData, ns: Iterable[int]) -> list[Score]:
    """S and T on held-out branches: see `scene_evaluation`."""
    assert isinstance(model, SampleMlp)
    scores = []
    for n in ns:
        for name, methods in scene_evaluation.branch_errors(model, data.held_out, n).items():
            for method, (mse, bias2) in methods.items():
                ratio = mse / methods["S"][0]
                scores.append(Score(config.name, name, method, n, mse, bias2, mse - bias2, ratio))
    return sorted(scores, key=lambda score: (score.data, score.n, score.method))


def run_errors(model: Mlp, sequences: Sequences, n: int) -> tuple[np.ndarray, np.ndarray]:
    """MSE of S_n and of T_n in each run, mean over integrands, `[run]`, in f64."""
    reference = sequences.reference.double()[:, None]
    s, t = sequences.estimates[:, :, n - 1], transformed(model, sequences, n)
    by_run = [(x.double() - reference).square().mean(dim=0).numpy() for x in (s, t)]
    return by_run[0], by_run[1]


def transformed(model: Mlp, sequences: Sequences, n: int) -> Tensor:
    """T_n, `[integrand, run]`, on the CPU."""
    if isinstance(model, SampleMlp):
        return transformed_samples(model, sequences, n)
    device = next(model.parameters()).device
    windows = sequences.estimates[:, :, n - model.window : n]
    parts = windows.reshape(-1, model.window).split(CHUNK)
    with torch.no_grad():
        t = torch.cat([model(part.to(device)).cpu() for part in parts])
    return t.reshape(windows.shape[:2])


def transformed_samples(model: SampleMlp, sequences: Sequences, n: int) -> Tensor:
    """T_n, `[integrand, run]`, on the CPU; all lanes of the sequences are one batch."""
    assert sequences.samples is not None
    device = next(model.parameters()).device
    sums = model.form.features(sequences.samples[..., :n].double()).sum(dim=-1).to(device)
    count = torch.tensor(n, dtype=torch.float64, device=device)
    unit = model.form.estimate(sums, count).abs().mean()
    with torch.no_grad():
        return model.transform(sums, count, unit).float().cpu()


def errors(estimates: np.ndarray, reference: np.ndarray) -> tuple[float, float, float]:
    """MSE, bias² and variance of `[integrand, run]`, in f64."""
    error = estimates.astype(np.float64) - reference[:, None]
    mse = np.square(error).mean()
    bias2 = np.square(error.mean(axis=1)).mean()
    return float(mse), float(bias2), float(mse - bias2)


def bayes_limits(config: Config, name: str, ns: Sequence[int]) -> dict[int, np.ndarray]:
    """The Bayes limit of each integrand and run, `[integrand, run]`, for the n of `BAYES_N`.

    For all families together it is that of an observer who knows which family a sequence is from.
    """
    data = config.data
    names = data.families if name == "all" else [name]
    samples = {
        family: families.held_out_samples(family, data.runs, data.terms, config.seed) for family in names
    }
    return {
        n: np.concatenate([bayes.limit(family, samples[family][..., :n]) for family in names])
        for n in BAYES_N
        if n in ns
    }


def ratio(scores: list[Score], data: str, n: int, method: str = "T") -> float:
    """MSE(method)/MSE(S)."""
    (score,) = [s for s in scores if (s.data, s.n, s.method) == (data, n, method)]
    return score.mse_ratio


def write_csv(path: Path, columns: list[str], rows: Iterable[Iterable[object]]) -> None:
    """Numbers with six digits; the old file stays until the new one is whole."""
    unfinished = path.with_name(path.name + ".part")
    with unfinished.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(columns)
        for row in rows:
            writer.writerow([f"{x:.6g}" if isinstance(x, float) else x for x in row])
    os.replace(unfinished, path)


def write_metrics(path: Path, scores: list[Score]) -> None:
    """One row per score."""
    write_csv(path, COLUMNS, map(astuple, scores))
