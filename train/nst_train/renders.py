"""Sequences of a scene's pixels, rendered by the `nst` binary.

Each run is one rendering with its own seed. The training runs take the seeds from `first_seed` on, the
evaluation runs the seeds after them, the reference the next one.
"""

import hashlib
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from nst_train import dataset
from nst_train.binary import REPOSITORY
from nst_train.binary import run as run_nst
from nst_train.config import RendersData
from nst_train.dataset import Dataset
from nst_train.errors import UserError
from nst_train.sequences import Data, Sequences

COLORS = 3
WINDOW_KEPT = 8  # terms that `nst render --keep window` keeps

CONSTANT_TOLERANCE = 1e-6
"""Estimates that differ by less than this, relative to the largest, differ by rounding only."""


@dataclass(frozen=True)
class Renders:
    """All lanes of all runs. `[lane]`: all pixels of R, then of G, then of B; of a grey scene only
    one channel, as the other two are equal."""

    scene: str  # fingerprint
    size: tuple[int, int]  # width, height
    estimates: np.ndarray  # [lane, run, term]
    reference: np.ndarray  # [lane], I
    training_runs: int

    def varying(self) -> np.ndarray:
        """Which lanes are not the same constant in all training runs, `[lane]`."""
        return varying(self.estimates[:, : self.training_runs])


def make_data(data: RendersData, cache: Path) -> Data:
    """Renders what `cache` does not contain yet, and drops the lanes in which nothing is random."""
    renders = load(data, cache)
    kept = renders.varying()
    if not kept.any():
        raise UserError(f"data.scene = {data.scene!r}: every pixel is constant, nothing to learn")
    reference = torch.from_numpy(renders.reference[kept])

    def sequences(runs: slice) -> Sequences:
        return Sequences(torch.from_numpy(renders.estimates[:, runs][kept]), reference)

    training = sequences(slice(None, data.runs))
    held_out = {Path(data.scene).stem: sequences(slice(data.runs, None))}
    return Data(training, held_out, f"scene:{renders.scene}")


def load(data: RendersData, cache: Path) -> Renders:
    """Renders what `cache` does not contain yet, and reads it."""
    scene = REPOSITORY / data.scene
    if not scene.is_file():
        raise UserError(f"data.scene: no such file: {scene}")
    folder = cache / scene_digest(scene)
    size = (data.size[0], data.size[1])
    runs = data.runs + data.evaluation_runs

    def rendered(count: int, spp: int, seed: int, first: int, *options: str) -> Dataset:
        how = f"{data.sampler}-depth{data.max_depth}-{data.pixel}"
        path = folder / f"{size[0]}x{size[1]}-{how}-{spp}spp-{count}runs-seed{seed}.safetensors"
        if not path.is_file():
            command = (
                *("--runs", count, "--spp", spp, "--size", f"{size[0]}x{size[1]}", "--seed", seed),
                *("--sampler", data.sampler, "--max-depth", data.max_depth, "--pixel", data.pixel),
            )
            render(scene, [*command, *options], path)
        found = dataset.read(path, size, count, list(range(first, spp + 1)))
        if found.sampler != data.sampler:
            raise UserError(
                f"{path}: made with the sampler '{found.sampler}', not '{data.sampler}'; "
                "delete the file and rerun"
            )
        return found

    all_runs = rendered(runs, data.terms, data.first_seed, 1)
    spp = data.reference_spp
    first = max(1, spp - WINDOW_KEPT + 1)
    last = rendered(1, spp, data.first_seed + runs, first, "--keep", "window")
    if all_runs.scene != last.scene:
        raise UserError(
            f"{all_runs.path}: rendered from {all_runs.scene}, but {last.path} from {last.scene}; "
            f"delete {folder} and rerun"
        )

    reference = last.run(0)[-1]
    grey = _is_grey(reference) and all(_is_grey(all_runs.run(run)) for run in range(runs))
    lanes = len(reference) // COLORS if grey else len(reference)
    estimates = np.empty((lanes, runs, data.terms), np.float32)
    for run in range(runs):
        estimates[:, run] = all_runs.run(run)[:, :lanes].T
    return Renders(last.scene, size, estimates, reference[:lanes].copy(), data.runs)


def _is_grey(lanes: np.ndarray) -> bool:
    """Whether the three channels of `[…, lane]` are equal."""
    red, green, blue = np.split(lanes, COLORS, axis=-1)
    return np.array_equal(red, green) and np.array_equal(red, blue)


def varying(estimates: np.ndarray) -> np.ndarray:
    """Which lanes of `[lane, run, term]` are not the same constant in all runs."""
    low, high = estimates.min(axis=(1, 2)), estimates.max(axis=(1, 2))
    return high - low > CONSTANT_TOLERANCE * np.maximum(np.abs(low), np.abs(high))


def scene_digest(scene: Path) -> str:
    """A hash of the content of the scene's folder: OBJ, materials, settings and textures."""
    digest = hashlib.sha256()
    for path in sorted(scene.parent.rglob("*")):
        if path.is_file():
            digest.update(path.relative_to(scene.parent).as_posix().encode() + b"\0")
            digest.update(hashlib.sha256(path.read_bytes()).digest())
    return f"{scene.stem}-{digest.hexdigest()[:12]}"


def render(scene: Path, options: list[object], dataset: Path) -> None:
    """Runs `nst render`, which writes its dataset to `dataset`."""
    dataset.parent.mkdir(parents=True, exist_ok=True)
    unfinished = dataset.with_suffix(".part.safetensors")
    run_nst("render", "--scene", scene, *options, "-o", unfinished)
    os.replace(unfinished, dataset)
