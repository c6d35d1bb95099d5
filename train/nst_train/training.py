"""Gradient descent on the loss of whole sequences."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from typing import Any

import torch
from torch import Tensor

from nst_train.config import Config
from nst_train.errors import UserError
from nst_train.losses import sequence_loss
from nst_train.model import Mlp
from nst_train.sequences import Sequences, mean_squared_errors, whitening, windows


def make_model(config: Config, estimates: Tensor) -> Mlp:
    """A network with PyTorch's default initialisation, seeded, or one that starts with T = S."""
    torch.manual_seed(config.seed)
    model = Mlp(config.window, config.hidden)
    if config.inputs == "whitened":
        model.whiten(*whitening(estimates, config.window))
    if config.start == "input":
        model.start_from_input()
    return model


class Descent(ABC):
    """A network, and all that its training depends on but the data.

    Adam; the learning rate falls from `config.learning_rate` to 0 along half a cosine, batch by batch.
    On a GPU the products between hidden layers are in bf16.
    """

    def __init__(self, config: Config, model: Mlp, batches: int, device: str) -> None:
        """`batches` is their number in an epoch."""
        self.config = config
        self.device = device
        self.model = model.to(device)
        self.model.mixed = device == "cuda"
        self.optimizer = torch.optim.Adam(self.model.parameters(), lr=config.learning_rate)
        self.rng = torch.Generator().manual_seed(config.seed)  # on the CPU: the same on all devices
        self.losses: list[float] = []  # mean loss of each epoch so far
        self.steps = 0
        self.steps_in_all = config.epochs * batches

    @abstractmethod
    def batch_losses(self) -> Iterator[tuple[Tensor, int]]:
        """The loss of each batch of an epoch, and how many integrands are in the batch. The weights change
        between them."""

    @property
    def epoch(self) -> int:
        """How many epochs are done."""
        return len(self.losses)

    def learning_rate(self) -> float:
        """The learning rate of the next batch."""
        progress = self.steps / self.steps_in_all
        return 0.5 * self.config.learning_rate * (1.0 + math.cos(math.pi * progress))

    def run_epoch(self) -> float:
        """Goes through all batches of an epoch, and returns the integrands' mean loss."""
        total = torch.zeros((), device=self.device)
        integrands = 0
        for loss, count in self.batch_losses():
            for group in self.optimizer.param_groups:
                group["lr"] = self.learning_rate()
            self.optimizer.zero_grad()
            loss.backward()
            self.optimizer.step()
            self.steps += 1
            total += loss.detach() * count
            integrands += count
        mean = total.item() / integrands
        if not math.isfinite(mean):
            raise UserError(
                f"training diverged: the loss of epoch {self.epoch + 1} is {mean}; "
                "lower learning_rate or raise epsilon"
            )
        self.losses.append(mean)
        return mean

    def state(self) -> dict[str, Any]:
        """All that changes during training."""
        return {
            "model": self.model.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "rng": self.rng.get_state(),
            "losses": list(self.losses),
            "steps": self.steps,
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Continues from a `state`."""
        self.model.load_state_dict(state["model"])
        self.optimizer.load_state_dict(state["optimizer"])
        self.rng.set_state(state["rng"].cpu())
        self.losses = list(state["losses"])
        self.steps = state["steps"]


class Training(Descent):
    """Training on sequences that stay the same: the paper's. They stay on the device."""

    def __init__(self, config: Config, sequences: Sequences, device: str = "cpu") -> None:
        count, _, terms = sequences.estimates.shape
        model = make_model(config, sequences.estimates)
        super().__init__(config, model, math.ceil(count / config.batch_size), device)
        self.n = torch.arange(config.window, terms + 1, device=device)
        self.estimates = sequences.estimates.to(device)
        self.reference = sequences.reference.to(device)
        e_s = mean_squared_errors(self.estimates, self.reference)
        self.e_s = e_s[:, config.window - 1 :]  # [integrand, n]

    def batch_losses(self) -> Iterator[tuple[Tensor, int]]:
        """All integrands once, in a random order."""
        order = torch.randperm(len(self.reference), generator=self.rng)
        for batch in order.split(self.config.batch_size):
            points = draw_points(len(self.n), self.config.terms_per_step, self.rng)
            yield self.loss(batch.to(self.device), points.to(self.device)), len(batch)

    def loss(self, batch: Tensor, points: Tensor) -> Tensor:
        """Equation 6 for some integrands, its sum over all n estimated from those at `points`."""
        inputs = windows(self.estimates[batch], self.config.window)[:, :, points]
        t = self.model(inputs)  # [integrand, run, n, window] to [integrand, run, n]
        e_t = mean_squared_errors(t, self.reference[batch])
        e_s = self.e_s[batch][:, points]
        loss = sequence_loss(self.config.loss, e_t, e_s, self.n[points], self.config.epsilon)
        return loss * (len(self.n) / len(points))


def draw_points(count: int, wanted: int, rng: torch.Generator) -> Tensor:
    """`wanted` of the indices 0 … count - 1, without repeats; all of them where `wanted` is 0."""
    if wanted == 0:
        return torch.arange(count)
    return torch.randperm(count, generator=rng)[:wanted]
