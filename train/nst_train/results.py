"""What a finished run stores: the network, in f16 if that costs little, and its scores."""

import torch

from nst_train import config as configs
from nst_train import evaluation, weights
from nst_train.evaluation import REPORTED_N, Score
from nst_train.model import Mlp
from nst_train.scene_renders import SceneData
from nst_train.sequences import Data

MOST_GAIN_LOST = 0.01
"""Weights are stored in f16 if that loses less than this part of the gain 1 − MSE(T)/MSE(S)."""


def reported_n(config: configs.Config, data: Data | SceneData) -> list[int]:
    """The n of tables: 8, 16, 32, 64 where the network has them, and the last."""
    every = evaluation.every_n(config, data)
    return sorted({n for n in REPORTED_N if n in every} | {every[-1]})


def finished(
    config: configs.Config, model: Mlp, data: Data | SceneData
) -> tuple[Mlp, torch.dtype, list[Score]]:
    """The network as it is stored, and its scores."""
    stored, dtype = rounded(config, model, data)
    return stored, dtype, evaluation.evaluate(config, stored, data)


def rounded(config: configs.Config, model: Mlp, data: Data | SceneData) -> tuple[Mlp, torch.dtype]:
    """The network as it is stored: its weights rounded to f16, if that costs little."""
    half = weights.rounded(model, torch.float16)
    ns = reported_n(config, data)
    full_scores = evaluation.network_scores(config, model, data, ns)
    half_scores = evaluation.network_scores(config, half, data, ns)
    dtype = torch.float16 if loses_little(full_scores, half_scores) else torch.float32
    return half if dtype == torch.float16 else model, dtype


def loses_little(full: list[Score], half: list[Score]) -> bool:
    """Whether rounding the weights takes less than `MOST_GAIN_LOST` of the gain at every n."""
    return all(
        h.mse_ratio - f.mse_ratio < MOST_GAIN_LOST * abs(1.0 - f.mse_ratio)
        for f, h in zip(full, half, strict=True)
        if f.method == "T"
    )


def provenance(config: configs.Config, data: Data | SceneData) -> weights.Provenance:
    """The provenance of a network, for the metadata of its weights."""
    random = isinstance(config.data, configs.RandomScenesData)
    sampler = config.data.sampler if isinstance(config.data, configs.RendersData) else None
    return weights.Provenance(
        trained_on=data.trained_on,
        samples=f"{config.window}..{config.data.terms}",
        loss=config.loss,
        epochs=config.epochs,
        seed=config.seed,
        config=f"{config.text}\n# The {config.setting} setting was used.\n",
        sampler="random" if random else sampler,
    )


def print_scores(scores: list[Score]) -> None:
    """A table of MSE ratios at the reported n."""
    methods = list(dict.fromkeys(s.method for s in scores if s.method != "S"))
    print("MSE as a multiple of the MSE of S, on held-out data:")
    print(f"{'data':>16} {'n':>4} " + " ".join(f"{method:>9}" for method in methods))
    ratios = {(s.data, s.n, s.method): s.mse_ratio for s in scores}
    for data, n in dict.fromkeys((s.data, s.n) for s in scores):
        if n in REPORTED_N:
            cells = (ratios.get((data, n, method)) for method in methods)
            line = " ".join(" " * 9 if cell is None else f"{cell:9.4g}" for cell in cells)
            print(f"{data:>16} {n:>4} {line}")
