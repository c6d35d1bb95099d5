"""Gradient descent on the loss of whole sequences."""

import math
from collections.abc import Iterator

import torch
from torch import Tensor

from nst_train.config import Config
from nst_train.errors import UserError
from nst_train.losses import sequence_loss
from nst_train.model import Mlp
from nst_train.sequences import Sequences, mean_squared_errors, windows


def make_model(config: Config) -> Mlp:
    """A network with PyTorch's default initialisation, seeded."""
    torch.manual_seed(config.seed)
    return Mlp(config.window, config.hidden)


def train(model: Mlp, sequences: Sequences, config: Config) -> Iterator[float]:
    """Trains `model` in place and yields the mean loss of each epoch.

    Adam; the learning rate falls from `config.learning_rate` to 0 along half a cosine, batch by batch.
    """
    rng = torch.Generator().manual_seed(config.seed)
    count, _, terms = sequences.estimates.shape
    n = torch.arange(config.window, terms + 1)
    e_s = mean_squared_errors(sequences.estimates, sequences.reference)[:, config.window - 1 :]

    batches_per_epoch = math.ceil(count / config.batch_size)
    optimizer = torch.optim.Adam(model.parameters(), lr=config.learning_rate)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(
        optimizer, T_max=config.epochs * batches_per_epoch
    )

    for epoch in range(config.epochs):
        total = 0.0
        for batch in torch.randperm(count, generator=rng).split(config.batch_size):
            points = draw_points(len(n), config.terms_per_step, rng)
            inputs = windows(sequences.estimates[batch], config.window)[:, :, points]
            t = model(inputs)  # [integrand, run, n, window] to [integrand, run, n]
            e_t = mean_squared_errors(t, sequences.reference[batch])
            loss = sequence_loss(
                config.loss, e_t, e_s[batch][:, points], n[points], config.epsilon
            ) * (len(n) / len(points))  # an estimate of the sum over all n

            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            schedule.step()
            total += loss.item() * len(batch)
        mean_loss = total / count
        if not math.isfinite(mean_loss):
            raise UserError(
                f"training diverged: the loss of epoch {epoch + 1} is {mean_loss}; "
                "lower learning_rate or raise epsilon"
            )
        yield mean_loss


def draw_points(count: int, wanted: int, rng: torch.Generator) -> Tensor:
    """`wanted` of the indices 0 … count - 1, without repeats; all of them where `wanted` is 0."""
    if wanted == 0:
        return torch.arange(count)
    return torch.randperm(count, generator=rng)[:wanted]
