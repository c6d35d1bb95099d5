"""Pictures of random scenes as sums over samples, rendered by the `nst` binary.

Of each scene, `runs · terms` samples of every pixel are rendered, and two references of other samples, the
halves. Only sums are stored, of φ_p for the powers of the network, in the four folds in which `nst` keeps
them: sample i is in fold i mod 4. Scenes that are stored are not rendered again.
"""

import hashlib
import os
import tempfile
import zipfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from nst_train import dataset, random_scenes, renders
from nst_train.config import RandomScenesData
from nst_train.errors import UserError
from nst_train.power_means import PowerMeans

FOLDS = 4
LEAST_N = 8
"""The least n of whole pictures; of a single fold it is a quarter."""
MOST_DRAWS = 4
"""Pictures of each n from the same samples."""
SPP = 16
"""Samples per rendered run: single samples are differences of f32 means, which are the less exact the more
there are."""
ROUNDING = 2.5e-7
"""Differences below this part of the largest sum are rounding: two roundings of f32 to the nearest."""
REFERENCE_SEED = 1_000_000
"""Added to the seed for the references."""


@dataclass(frozen=True)
class Scene:
    """A scene's pictures; lanes are all pixels of R, then of G, then of B."""

    name: str
    branch: str
    sums: dict[int, Tensor]  # by n: [draw, fold, power, lane], f32
    reference: Tensor  # [half, lane], f32
    deviation: Tensor  # [lane], of one sample, f32


@dataclass(frozen=True)
class SceneData:
    """What a network is trained on, and what it is scored on: scenes of other branches."""

    training: list[Scene]
    held_out: list[Scene]
    trained_on: str  # for the metadata of the weights


def counts(terms: int) -> list[int]:
    """The n of pictures: powers of two from `LEAST_N` to `terms`."""
    return [2**k for k in range(3, terms.bit_length())]


def make_data(data: RandomScenesData, form: PowerMeans, cache: Path) -> SceneData:
    """Renders what `cache` does not contain yet, and reads all."""
    training = list(load(data, data.branches, data.scenes, form, cache))
    held_out = list(load(data, data.held_out, data.held_out_scenes, form, cache))
    parts = [f"family:{family}" for family in data.families]
    parts += [f"random:{branch}" for branch in data.branches]
    return SceneData(training, held_out, ",".join(parts))


def load(
    data: RandomScenesData, branches: list[str], scenes: int, form: PowerMeans, cache: Path
) -> Iterator[Scene]:
    """Scenes of some branches, the first of each, then the second, and so on."""
    for index in range(scenes):
        for branch in branches:
            yield load_scene(data, branch, index, form, cache)


def load_scene(data: RandomScenesData, branch: str, index: int, form: PowerMeans, cache: Path) -> Scene:
    """One scene, which is rendered if `cache` does not contain it."""
    scene = random_scenes.random_scene(branch, index, data.first_seed)
    path = cache / f"{scene.name}-{_digest(scene, data, form)}.npz"
    if not path.is_file():
        arrays = render(scene, data, form)
        path.parent.mkdir(parents=True, exist_ok=True)
        unfinished = path.with_suffix(".part.npz")
        np.savez(unfinished, **arrays)
        os.replace(unfinished, path)
    try:
        with np.load(path) as file:
            found = {key: torch.from_numpy(file[key]) for key in file.files}
        sums = {n: found[str(n)] for n in counts(data.terms)}
        return Scene(scene.name, branch, sums, found["reference"], found["deviation"])
    except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise UserError(f"{path}: damaged; delete it and rerun: {error}") from error


def _digest(scene: random_scenes.RandomScene, data: RandomScenesData, form: PowerMeans) -> str:
    """Of everything that the stored sums depend on but the renderer."""
    digest = hashlib.sha256()
    asked = (data.size, data.runs, data.terms, data.reference_spp, data.first_seed, form.powers)
    digest.update(repr(asked).encode())
    for name, content in sorted(scene.files().items()):
        digest.update(name.encode() + b"\0" + hashlib.sha256(content).digest())
    return digest.hexdigest()[:12]


def render(
    scene: random_scenes.RandomScene, data: RandomScenesData, form: PowerMeans
) -> dict[str, np.ndarray]:
    """The arrays of a scene's file."""
    size = (data.size[0], data.size[1])
    with tempfile.TemporaryDirectory() as folder:
        path = random_scenes.write(scene, Path(folder))

        def rendered(runs: int, spp: int, seed: int, first: int, *options: str) -> np.ndarray:
            target = Path(folder) / f"seed{seed}.safetensors"
            command = ("--runs", runs, "--spp", spp, "--size", f"{size[0]}x{size[1]}", "--seed", seed)
            renders.render(path, [*command, "--sampler", "random", "--pixel", "box", *options], target)
            found = dataset.read(target, size, runs, list(range(first, spp + 1)))
            return np.stack([found.run(run) for run in range(runs)])

        runs = data.runs * data.terms // SPP
        samples = np.concatenate([samples_of(run) for run in rendered(runs, SPP, data.first_seed, 1)])
        spp = data.reference_spp
        first = max(1, spp - renders.WINDOW_KEPT + 1)
        seed = data.first_seed + REFERENCE_SEED
        reference = rendered(2, spp, seed, first, "--keep", "window")[:, -1]
    arrays = {str(n): pictures(samples, n, form) for n in counts(data.terms)}
    deviation = samples.std(axis=0, dtype=np.float64, ddof=1).astype(np.float32)
    return arrays | {"reference": reference, "deviation": deviation}


def samples_of(means: np.ndarray) -> np.ndarray:
    """The samples behind running means `[term, lane]`, of the same shape; rounding becomes 0."""
    totals = means.astype(np.float64) * np.arange(1, len(means) + 1)[:, None]
    samples = np.diff(totals, axis=0, prepend=0.0)
    samples[np.abs(samples) <= ROUNDING * np.abs(totals).max(axis=0)] = 0.0
    return samples


def pictures(samples: np.ndarray, n: int, form: PowerMeans) -> np.ndarray:
    """Sums `[draw, fold, power, lane]` of pictures of n samples each, of samples `[sample, lane]`."""
    draws = min(MOST_DRAWS, len(samples) // n)
    apart = torch.from_numpy(samples[: draws * n]).view(draws, n // FOLDS, FOLDS, -1)
    return form.features(apart).sum(dim=2).permute(1, 2, 0, 3).float().numpy()
