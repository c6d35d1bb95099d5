"""Sequences of a scene's pixels, rendered by the `nst` binary.

Each run is one rendering with its own seed. The training runs take the seeds from `first_seed` on, the
evaluation runs the seeds after them, the reference the next one.
"""

import hashlib
import os
import subprocess
from pathlib import Path

import numpy as np
import torch

from nst_train import sequence_file
from nst_train.config import RendersData
from nst_train.errors import UserError
from nst_train.sequence_file import SequenceFile
from nst_train.sequences import Data, Sequences

REPOSITORY = Path(__file__).resolve().parents[2]

CONSTANT_TOLERANCE = 1e-6
"""Estimates that differ by less than this, relative to the largest, differ by rounding only."""


def make_data(data: RendersData, cache: Path) -> Data:
    """Renders what `cache` does not hold yet, and drops the lanes in which nothing is random."""
    scene = REPOSITORY / data.scene
    if not scene.is_file():
        raise UserError(f"data.scene: no such file: {scene}")
    folder = cache / scene_digest(scene)
    size = (data.size[0], data.size[1])

    def rendered(seed: int, spp: int, keep: str) -> SequenceFile:
        path = folder / f"{size[0]}x{size[1]}-{spp}spp-seed{seed}.exr"
        if not path.is_file():
            render(scene, size, spp, seed, keep, path)
        return sequence_file.read(path, size)

    seeds = range(data.first_seed, data.first_seed + data.runs + data.evaluation_runs)
    reference_file = rendered(seeds.stop, data.reference_spp, keep="window")
    reference = reference_file.final()
    lanes = len(reference)
    estimates = np.empty((lanes, len(seeds), data.terms), np.float32)  # [integrand, run, term]
    for run, seed in enumerate(seeds):
        file = rendered(seed, data.terms, keep="all")
        if file.scene != reference_file.scene:
            raise UserError(
                f"{file.path}: rendered from {file.scene}, but {reference_file.path} from "
                f"{reference_file.scene}; delete {folder} and rerun"
            )
        estimates[:, run] = file.terms(data.terms)

    training, evaluation = estimates[:, : data.runs], estimates[:, data.runs :]
    kept = varying(training)
    if not kept.any():
        raise UserError(f"data.scene = {data.scene!r}: every pixel is constant, nothing to learn")

    def sequences(runs: np.ndarray) -> Sequences:
        return Sequences(torch.from_numpy(runs[kept]), torch.from_numpy(reference[kept]))

    held_out = {scene.stem: sequences(evaluation)}
    return Data(sequences(training), held_out, f"scene:{reference_file.scene}")


def varying(estimates: np.ndarray) -> np.ndarray:
    """Which lanes of `[lane, run, term]` are not the same constant in all runs."""
    low, high = estimates.min(axis=(1, 2)), estimates.max(axis=(1, 2))
    return high - low > CONSTANT_TOLERANCE * np.maximum(np.abs(low), np.abs(high))


def scene_digest(scene: Path) -> str:
    """Names the content of the scene's folder: OBJ, materials, settings and textures."""
    digest = hashlib.sha256()
    for path in sorted(scene.parent.rglob("*")):
        if path.is_file():
            digest.update(path.relative_to(scene.parent).as_posix().encode() + b"\0")
            digest.update(hashlib.sha256(path.read_bytes()).digest())
    return f"{scene.stem}-{digest.hexdigest()[:12]}"


def renderer() -> Path:
    """The `nst` binary: the environment variable NST, or the release build of this repository."""
    path = Path(os.environ.get("NST") or REPOSITORY / "target" / "release" / "nst")
    if not path.is_file():
        raise UserError(
            f"{path}: no such renderer; build it with `cargo build --release` in {REPOSITORY}, "
            "or set the environment variable NST to an nst binary"
        )
    return path


def render(
    scene: Path, size: tuple[int, int], spp: int, seed: int, keep: str, sequence: Path
) -> None:
    """Runs `nst render` and leaves the sequence file at `sequence`."""
    sequence.parent.mkdir(parents=True, exist_ok=True)
    unfinished = sequence.with_suffix(".part.exr")
    image = sequence.with_suffix(".image.exr")
    command = [
        *(renderer(), "render", "--scene", scene),
        *("--spp", spp, "--size", f"{size[0]}x{size[1]}", "--seed", seed),
        *("--keep", keep, "--transform", "none"),
        *("--sequence", unfinished, "-o", image, "--quiet"),
    ]
    try:
        result = subprocess.run(map(str, command), capture_output=True, text=True, errors="replace")
    except OSError as error:
        raise UserError(f"{command[0]}: cannot run the renderer: {error.strerror}") from error
    image.unlink(missing_ok=True)
    if result.returncode != 0 or not unfinished.is_file():
        said = " ".join(result.stderr.split()) or "it said nothing"
        raise UserError(f"nst render of {scene}, seed {seed}, failed ({result.returncode}): {said}")
    os.replace(unfinished, sequence)
