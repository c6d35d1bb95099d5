"""Gradient descent on pictures of random scenes and on 1D families, for networks that see the samples.

Every batch is of some pictures. A picture has some of a scene's folds, as a guard that holds folds out
sees it, at a drawn n; or its lanes are one run each of fresh integrands of a family. The error of T is
compared with that of S in the same picture, so that a picture with an outlier counts no more than others:

    loss = mean over p of ln(0.1 + Σ w_p (T − I)² / (Σ w_p (S − I)² + ε)),   w_p = (I/u + 0.15)^−p

p = 0 is the mean squared error, which the brightest lanes decide; p = 1 and 2 give the dark ones a say.
All values are in units of u, the sums are means over lanes, and I is the mean of the two references. As
these are of other samples, their noise adds to both errors, and on average nothing to the gradient.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor

from nst_train import fresh
from nst_train.config import Config, RandomScenesData
from nst_train.model import SampleMlp
from nst_train.sample_training import draw_counts, sums_and_unit
from nst_train.scene_renders import FOLDS, Scene, SceneData, counts
from nst_train.sequences import whitening_of
from nst_train.training import Descent

WEIGHTS = (0, 1, 2)
"""The p of the loss."""
DARK = 0.15
"""Added to I/u, so that lanes far below u are not all that counts."""
LEAST_RATIO = 0.1
"""Added to the ratio of errors: where T is far better than S, being better still matters less."""
WHITENED_PICTURES = 200
"""How many pictures the scale of inputs is found from."""


@dataclass(frozen=True)
class Pictures:
    """Sums of n samples of some lanes of each picture, and what they estimate; f64."""

    sums: Tensor  # [power, picture, lane]
    n: Tensor  # [picture, 1]
    unit: Tensor  # [picture, 1]: mean of |S| over all lanes of the picture
    reference: Tensor  # [picture, lane]


class SceneTraining(Descent):
    """Pictures are drawn anew for each batch."""

    def __init__(self, config: Config, data: SceneData, device: str = "cpu") -> None:
        assert isinstance(config.data, RandomScenesData)
        assert config.samples is not None
        self.data = config.data
        self.form = config.samples
        self.scenes = data.training
        super().__init__(config, make_model(config, data), config.data.batches, device)

    def batch_losses(self) -> Iterator[tuple[Tensor, int]]:
        """Batches of an epoch."""
        for _ in range(self.data.batches):
            pictures = self.draw()
            yield self.loss(pictures), len(pictures.n)

    def draw(self) -> Pictures:
        """The pictures of a batch: a family's, or scenes'."""
        if torch.rand((), generator=self.rng) < self.data.family_share:
            return draw_family(self.config, self.rng)
        return draw_scenes(self.config, self.scenes, self.config.terms_per_step, self.rng)

    def loss(self, pictures: Pictures) -> Tensor:
        """The mean loss of pictures."""
        sums, n, unit = (x.to(self.device) for x in (pictures.sums, pictures.n, pictures.unit))
        values = (self.model.transform(sums, n, unit), self.form.estimate(sums, n))
        t, s, reference = ((x / unit).float() for x in (*values, pictures.reference.to(self.device)))
        return loss_of(t, s, reference, self.config.epsilon)


def loss_of(t: Tensor, s: Tensor, reference: Tensor, epsilon: float) -> Tensor:
    """The loss above of T, S and I `[…, lane]` in units of u; its mean over pictures."""
    weights = torch.stack([(reference.abs() + DARK) ** -p for p in WEIGHTS])
    e_t, e_s = ((weights * (x - reference).square()).mean(dim=-1) for x in (t, s))
    return (LEAST_RATIO + e_t / (e_s + epsilon)).log().mean()


def draw_scenes(config: Config, scenes: list[Scene], count: int, rng: torch.Generator) -> Pictures:
    """Pictures of any scenes, at most `batch_size` lanes of each."""
    parts = [draw_scene(config, scenes, rng) for _ in range(count)]
    sums, n, unit, reference = (torch.stack(values) for values in zip(*parts, strict=True))
    return Pictures(sums.transpose(0, 1), n[:, None], unit[:, None], reference)


def draw_scene(
    config: Config, scenes: list[Scene], rng: torch.Generator
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """The fields of `Pictures` for a picture of some scene, of one to all of its folds."""

    def pick(count: int) -> int:
        return int(torch.randint(count, (), generator=rng))

    assert config.samples is not None
    scene = scenes[pick(len(scenes))]
    ns = counts(config.data.terms)
    n = ns[pick(len(ns))]
    folds = torch.randperm(FOLDS, generator=rng)[: 1 + pick(FOLDS)]
    of_n = scene.sums[n]
    sums = of_n[pick(len(of_n)), folds].double().sum(dim=0)
    count = torch.tensor(float(n * len(folds) // FOLDS), dtype=torch.float64)
    unit = config.samples.estimate(sums, count).abs().mean()
    reference = scene.reference.double().mean(dim=0)
    if config.batch_size < len(reference):
        lanes = torch.randperm(len(reference), generator=rng)[: config.batch_size]
        sums, reference = sums[:, lanes], reference[lanes]
    return sums, count, unit, reference


def draw_family(config: Config, rng: torch.Generator) -> Pictures:
    """Fresh integrands of one family at `terms_per_step` n, even in log n."""
    assert isinstance(config.data, RandomScenesData)
    assert config.samples is not None
    families = config.data.families
    name = families[int(torch.randint(len(families), (), generator=rng))]
    n = draw_counts(config.window, config.data.terms, config.terms_per_step, rng)
    lanes = fresh.draw(name, config.batch_size, int(n[-1]), rng)
    sums, unit = sums_and_unit(config.samples, lanes.samples.double(), n)
    reference = lanes.reference.double().expand(len(n), -1)
    return Pictures(sums.transpose(1, 2), n.double()[:, None], unit[:, None], reference)


def make_model(config: Config, data: SceneData) -> SampleMlp:
    """A seeded network whose inputs have been whitened over pictures of training."""
    assert config.samples is not None
    torch.manual_seed(config.seed)
    model = SampleMlp(config.samples, config.hidden, (config.window, config.data.terms))
    rng = torch.Generator().manual_seed(config.seed)
    pictures = draw_scenes(config, data.training, WHITENED_PICTURES, rng)
    inputs = model.inputs(pictures.sums, pictures.n, pictures.unit).flatten(0, 1)
    model.whiten(*whitening_of(inputs.mean(dim=0), inputs.T @ inputs / len(inputs), drop=True))
    if config.start == "input":
        model.start_from_input()
    return model
