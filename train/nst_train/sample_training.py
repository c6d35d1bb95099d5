"""Gradient descent on integrands that are seen once, for networks that see the samples."""

import math
from collections.abc import Iterator

import torch
from torch import Tensor

from nst_train import fresh
from nst_train.config import Config, FreshFamiliesData
from nst_train.fresh import Lanes
from nst_train.losses import sequence_loss
from nst_train.model import SampleMlp
from nst_train.power_means import PowerMeans
from nst_train.sequences import Data, whitening_of
from nst_train.training import Descent

WHITENED_N = 6
"""How many n the scale of inputs is found from; a small part of the time of training."""


class SampleTraining(Descent):
    """Every batch has new integrands, with one run each.

    A batch is of one of the held-out sets: a single family, or all families together. So its unit is the
    one that a network meets there. The loss takes the error of S to be that of the lane's whole family.
    """

    def __init__(self, config: Config, data: Data, device: str = "cpu") -> None:
        assert isinstance(config.data, FreshFamiliesData)
        assert config.samples is not None
        self.form = config.samples
        self.families = config.data.families
        self.terms = config.data.terms
        first = data.training
        assert first.samples is not None
        lanes = Lanes(first.samples[:, 0], first.reference)
        errors = (lanes.samples - lanes.reference[:, None]).square().double().mean(dim=1)
        self.variances = errors.view(len(self.families), -1).mean(dim=1).float().to(device)
        super().__init__(config, make_model(config, lanes), config.data.batches, device)

    def batch_losses(self) -> Iterator[tuple[Tensor, int]]:
        """Batches of an epoch."""
        for _ in range(self.config.data.batches):
            lanes, family = self.draw()
            points = draw_counts(self.config.window, self.terms, self.config.terms_per_step, self.rng)
            yield self.loss(lanes, family, points), len(lanes)

    def draw(self) -> tuple[Lanes, Tensor]:
        """The lanes of a batch, and the index of each one's family."""
        count = len(self.families)
        chosen = torch.randint(count + (count > 1), (1,), generator=self.rng).item()
        indices = [chosen] if chosen < count else range(count)
        size = math.ceil(self.config.batch_size / len(indices))
        parts = [fresh.draw(self.families[i], size, self.terms, self.rng) for i in indices]
        return fresh.join(parts), torch.tensor(list(indices)).repeat_interleave(size)

    def loss(self, lanes: Lanes, family: Tensor, n: Tensor) -> Tensor:
        """Equation 6, its sum over all n estimated from those in `n`."""
        sums, unit = sums_and_unit(self.form, lanes.samples.to(self.device), n.to(self.device))
        counts = n.to(self.device, torch.float32)
        t = self.model.transform(sums, counts, unit)  # [lane, n]
        e_t = (t - lanes.reference.to(self.device)[:, None]).square()
        e_s = self.variances[family.to(self.device)][:, None] / counts
        loss = sequence_loss(self.config.loss, e_t, e_s, counts, self.config.epsilon)
        return loss / len(n)


def sums_and_unit(form: PowerMeans, samples: Tensor, n: Tensor) -> tuple[Tensor, Tensor]:
    """Sums `[power, lane, n]` of the first n samples of `[lane, term]`, and the unit `[n]`."""
    sums = form.features(samples).cumsum(dim=-1)[..., n - 1]
    return sums, form.estimate(sums, n).abs().mean(dim=0)


def make_model(config: Config, lanes: Lanes) -> SampleMlp:
    """A seeded network whose inputs have been whitened over these lanes, at some n between the ends."""
    assert config.samples is not None
    torch.manual_seed(config.seed)
    terms = lanes.samples.shape[1]
    model = SampleMlp(config.samples, config.hidden, (config.window, terms))
    rng = torch.Generator().manual_seed(config.seed)
    n = draw_counts(config.window, terms, WHITENED_N, rng)
    sums, unit = sums_and_unit(config.samples, lanes.samples.double(), n)
    inputs = model.inputs(sums, n.double(), unit).reshape(-1, config.samples.width)
    model.whiten(*whitening_of(inputs.mean(dim=0), inputs.T @ inputs / len(inputs), drop=True))
    if config.start == "input":
        model.start_from_input()
    return model


def draw_counts(least: int, most: int, count: int, rng: torch.Generator) -> Tensor:
    """`count` sample counts, even in log n: one of each equal part of [log least, log (most + 1))."""
    position = (torch.arange(count) + torch.rand(count, generator=rng)) / count
    drawn = (least * ((most + 1) / least) ** position.double()).long()
    return drawn.clamp(least, most)
