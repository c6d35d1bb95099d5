"""A run's folder: one experiment from its data to its weights, in as many sittings as it takes."""

import importlib.metadata
import json
import os
import platform
import subprocess
import time
from pathlib import Path
from typing import Any

import torch
from torch.utils.tensorboard import SummaryWriter

from nst_train import config as configs
from nst_train import evaluation, families, renders, weights
from nst_train.errors import UserError
from nst_train.evaluation import REPORTED_N, Score
from nst_train.model import Mlp
from nst_train.progress import Progress
from nst_train.sequences import Data
from nst_train.training import Training

CHECKPOINT_SECONDS = 30.0
CHECKPOINT_FORMAT = "nst-checkpoint-1"
REPORTS = 20
"""How many times in a run the held-out sequences are scored and a line is printed."""

MOST_GAIN_LOST = 0.01
"""Weights are stored in f16 if that loses less than this part of the gain 1 − MSE(T)/MSE(S)."""


def run(config: configs.Config, out: Path, device: str = "cpu") -> list[Score]:
    """Trains, or goes on training, and leaves weights and scores in `out`."""
    claim(out, config)
    data = load_data(config, out)
    count, runs, terms = data.training.estimates.shape
    print(
        f"{config.name}, {config.setting} setting, on {device}: {count} integrands, {runs} runs, "
        f"{terms} terms",
        flush=True,
    )
    training = Training(config, data.training, device)
    seconds_at = resume(out, training, data.trained_on)
    write_description(out, config, data, device)
    train(out, training, data, seconds_at)

    model, dtype, scores = finished(config, training.model.cpu().folded(), data)
    print_scores(scores)
    evaluation.write_metrics(out / "metrics.csv", scores)
    path = out / f"{config.name}.safetensors"
    weights.save(path, model, provenance(config, data), dtype)
    print(f"wrote {path} ({str(dtype).removeprefix('torch.')}), {seconds_at[-1]:.0f} s of training")
    return scores


def claim(out: Path, config: configs.Config) -> None:
    """Makes the folder, or refuses one that holds another run."""
    out.mkdir(parents=True, exist_ok=True)
    for name, text in (("config.toml", config.text), ("setting", config.setting + "\n")):
        path = out / name
        if path.is_file() and path.read_text(encoding="utf-8") != text:
            raise UserError(
                f"{path}: {out} holds a run of another config or setting; "
                "give another --out, or delete that folder"
            )
        path.write_text(text, encoding="utf-8")


def load_data(config: configs.Config, out: Path) -> Data:
    """Rendered runs are kept in `out` and used again."""
    if isinstance(config.data, configs.FamiliesData):
        return families.make_data(
            config.data.families, config.data.runs, config.data.terms, config.seed
        )
    return renders.make_data(config.data, cache=out / "renders")


def train(out: Path, training: Training, data: Data, seconds_at: list[float]) -> None:
    """Trains to the last epoch; `seconds_at` holds the seconds of training up to the end of each epoch
    in all sittings, and is added to."""
    config = training.config
    seconds = seconds_at[-1] if seconds_at else 0.0
    last_saved = time.perf_counter()
    log = SummaryWriter(out / "tensorboard", purge_step=training.epoch + 1)
    with Progress(config.epochs, training.epoch) as progress:
        while training.epoch < config.epochs:
            start = time.perf_counter()
            loss = training.run_epoch()
            seconds += time.perf_counter() - start
            seconds_at.append(seconds)
            epoch = training.epoch
            log.add_scalar("loss", loss, epoch)
            log.add_scalar("learning rate", training.learning_rate(), epoch)
            report = epoch % max(1, config.epochs // REPORTS) == 0
            if report:
                ns = reported_n(config, data)
                for score in evaluation.network_scores(config, training.model, data, ns):
                    if score.method == "T":
                        tag = f"held-out MSE ratio/{score.data} n={score.n}"
                        log.add_scalar(tag, score.mse_ratio, epoch)
            progress.update(loss, seconds, report)
            if time.perf_counter() - last_saved > CHECKPOINT_SECONDS or epoch == config.epochs:
                save(out, training, data.trained_on, seconds_at)
                last_saved = time.perf_counter()
    log.close()


def save(out: Path, training: Training, trained_on: str, seconds_at: list[float]) -> None:
    """The checkpoint and the history so far."""
    state = training.state() | {
        "format": CHECKPOINT_FORMAT,
        "trained_on": trained_on,
        "seconds_at": seconds_at,
    }
    path = out / "checkpoint.pt"
    unfinished = path.with_name(path.name + ".part")
    torch.save(state, unfinished)
    os.replace(unfinished, path)
    write_history(out, training.losses, seconds_at)


def resume(out: Path, training: Training, trained_on: str) -> list[float]:
    """Goes on from the folder's checkpoint, if there is one; returns its `seconds_at`."""
    path = out / "checkpoint.pt"
    if not path.is_file():
        return []
    damaged = UserError(f"{path}: not a checkpoint, or a damaged one; delete it to start again")
    try:
        state: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:  # of many kinds: the unpickler takes the file for a program
        raise damaged from error
    if not isinstance(state, dict) or state.get("format") != CHECKPOINT_FORMAT:
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


def write_description(out: Path, config: configs.Config, data: Data, device: str) -> None:
    """versions.json: what ran, where, on what."""
    known = {
        "trained_on": data.trained_on,
        "setting": config.setting,
        "nst": nst_version() if isinstance(config.data, configs.RendersData) else None,
        "torch": torch.__version__,
        "numpy": importlib.metadata.version("numpy"),
        "python": platform.python_version(),
        "device": torch.cuda.get_device_name() if device == "cuda" else platform.machine(),
        "threads": torch.get_num_threads(),
    }
    path = out / "versions.json"
    path.write_text(json.dumps(known, indent=2) + "\n", encoding="utf-8")


def nst_version() -> str:
    """What `nst --version` says."""
    line = [str(renders.renderer()), "--version"]
    return subprocess.run(line, capture_output=True, text=True, check=False).stdout.strip()


def reported_n(config: configs.Config, data: Data) -> list[int]:
    """The n of tables: 8, 16, 32, 64 where the network has them, and the last."""
    every = evaluation.every_n(config, data)
    return sorted({n for n in REPORTED_N if n in every} | {every[-1]})


def finished(
    config: configs.Config, model: Mlp, data: Data
) -> tuple[Mlp, torch.dtype, list[Score]]:
    """The network as it is stored, and its scores."""
    half = weights.rounded(model, torch.float16)
    ns = reported_n(config, data)
    full_scores = evaluation.network_scores(config, model, data, ns)
    half_scores = evaluation.network_scores(config, half, data, ns)
    dtype = torch.float16 if loses_little(full_scores, half_scores) else torch.float32
    stored = half if dtype == torch.float16 else model
    return stored, dtype, evaluation.evaluate(config, stored, data)


def loses_little(full: list[Score], half: list[Score]) -> bool:
    """Whether rounding the weights takes less than `MOST_GAIN_LOST` of the gain at every n."""
    return all(
        h.mse_ratio - f.mse_ratio < MOST_GAIN_LOST * abs(1.0 - f.mse_ratio)
        for f, h in zip(full, half, strict=True)
        if f.method == "T"
    )


def provenance(config: configs.Config, data: Data) -> weights.Provenance:
    """For the metadata of the weights."""
    rendered = isinstance(config.data, configs.RendersData)
    return weights.Provenance(
        trained_on=data.trained_on,
        samples=f"{config.window}..{config.data.terms}",
        loss=config.loss,
        epochs=config.epochs,
        seed=config.seed,
        config=f"{config.text}\n# The {config.setting} setting was used.\n",
        sampler=config.data.sampler if rendered else None,
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
