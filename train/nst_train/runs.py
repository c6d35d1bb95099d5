"""A run's folder: one experiment from its data to its weights. A run may be interrupted and continued."""

import importlib.metadata
import json
import platform
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import torch
from torch.utils.tensorboard import SummaryWriter

from nst_train import (
    binary,
    checkpoint,
    evaluation,
    families,
    fresh,
    renders,
    results,
    scene_renders,
    weights,
)
from nst_train import config as configs
from nst_train.errors import UserError
from nst_train.evaluation import Score
from nst_train.progress import Progress
from nst_train.sample_training import SampleTraining
from nst_train.scene_renders import SceneData
from nst_train.scene_training import SceneTraining
from nst_train.sequences import Data
from nst_train.training import Descent, Training

CHECKPOINT_SECONDS = 30.0
"""The least time between two checkpoints: what an interruption can cost."""
RENDERED = (configs.RendersData, configs.RandomScenesData)
REPORTS = 20
"""How many times in a run the held-out sequences are scored and a line is printed."""


def run(config: configs.Config, out: Path, device: str = "cpu") -> list[Score]:
    """Trains, or continues training, and writes weights and scores to `out`."""
    claim(out, config)
    data = load_data(config, out)
    print(f"{config.name}, {config.setting} setting, on {device}: {size_of(data)}", flush=True)
    training = make_training(config, data, device)
    seconds_at = checkpoint.resume(out, training, data.trained_on)
    write_description(out, config, data, device)
    train(out, training, data, seconds_at)

    model, dtype, scores = results.finished(config, training.model.cpu().folded(), data)
    results.print_scores(scores)
    evaluation.write_metrics(out / "metrics.csv", scores)
    path = out / f"{config.name}.safetensors"
    weights.save(path, model, results.provenance(config, data), dtype)
    print(f"wrote {path} ({str(dtype).removeprefix('torch.')}), {seconds_at[-1]:.0f} s of training")
    return scores


def size_of(data: Data | SceneData) -> str:
    """How much there is to train on, in words."""
    if isinstance(data, SceneData):
        return f"{len(data.training)} scenes, {len(data.held_out)} held out"
    count, runs, terms = data.training.estimates.shape
    return f"{count} integrands, {runs} runs, {terms} terms"


def claim(out: Path, config: configs.Config) -> None:
    """Makes the folder, or refuses one with another run."""
    out.mkdir(parents=True, exist_ok=True)
    for name, text in (("config.toml", config.text), ("setting", config.setting + "\n")):
        path = out / name
        if path.is_file() and path.read_text(encoding="utf-8") != text:
            raise UserError(
                f"{path}: {out} contains a run of another config or setting; "
                "give another --out, or delete that folder"
            )
        path.write_text(text, encoding="utf-8")


def load_data(config: configs.Config, out: Path) -> Data | SceneData:
    """Rendered runs are kept in `out` and used again; of random scenes beside it, for other runs, too."""
    if isinstance(config.data, configs.RandomScenesData):
        return scene_renders.make_data(config.data, config.samples, out.parent / "random-scenes")
    if isinstance(config.data, configs.FreshFamiliesData):
        return fresh.make_data(config.data.families, config.data.runs, config.data.terms, config.seed)
    if isinstance(config.data, configs.FamiliesData):
        return families.make_data(config.data.families, config.data.runs, config.data.terms, config.seed)
    return renders.make_data(config.data, cache=out / "renders")


def make_training(config: configs.Config, data: Data | SceneData, device: str) -> Descent:
    """Training that has not begun."""
    if isinstance(data, SceneData):
        return SceneTraining(config, data, device)
    if config.samples is not None:
        return SampleTraining(config, data, device)
    return Training(config, data.training, device)


def train(
    out: Path,
    training: Descent,
    data: Data | SceneData,
    seconds_at: list[float],
    clock: Callable[[], float] = time.perf_counter,
) -> None:
    """Trains to the last epoch; `seconds_at` has the seconds of training, by this clock, up to the end
    of each epoch in all sittings, and is added to."""
    config = training.config
    seconds = seconds_at[-1] if seconds_at else 0.0
    last_saved = time.perf_counter()
    log = SummaryWriter(out / "tensorboard", purge_step=training.epoch + 1)
    with Progress(config.epochs, training.epoch) as progress:
        while training.epoch < config.epochs:
            start = clock()
            loss = training.run_epoch()
            seconds += clock() - start
            seconds_at.append(seconds)
            epoch = training.epoch
            log.add_scalar("loss", loss, epoch)
            log.add_scalar("learning rate", training.learning_rate(), epoch)
            report = epoch % max(1, config.epochs // REPORTS) == 0
            if report:
                ns = results.reported_n(config, data)
                for score in evaluation.network_scores(config, training.model, data, ns):
                    if score.method == "T":
                        tag = f"held-out MSE ratio/{score.data} n={score.n}"
                        log.add_scalar(tag, score.mse_ratio, epoch)
            progress.update(loss, seconds, report)
            if time.perf_counter() - last_saved > CHECKPOINT_SECONDS or epoch == config.epochs:
                checkpoint.save(out, training, data.trained_on, seconds_at)
                last_saved = time.perf_counter()
    log.close()


def write_description(out: Path, config: configs.Config, data: Data | SceneData, device: str) -> None:
    """versions.json: the versions of programs, and the device."""
    known = {
        "trained_on": data.trained_on,
        "setting": config.setting,
        "nst": nst_version() if isinstance(config.data, RENDERED) else None,
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
    line = [str(binary.renderer()), "--version"]
    return subprocess.run(line, capture_output=True, text=True, check=False).stdout.strip()
