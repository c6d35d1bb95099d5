"""Gradient descent on what the network's weights make of whole pictures.

With r = E_T / best, s = E_S / best and c = E_closed / best of a picture in one metric, where the best is the
error of S or of the denoiser, whichever is less, the loss is the mean over pictures and metrics of

    ln(r + floor) + harm · relu ln(r/s) + regret · relu ln((r + ε)/(min(c, s) + ε)),    ε = regret_floor
"""

from collections.abc import Callable, Iterator

import torch
from torch import Tensor

from nst_train.errors import UserError
from nst_train.guard_training.data import Item, normalisation
from nst_train.guard_training.forms import PAIRS
from nst_train.guard_training.settings import Loss, Settings
from nst_train.guard_training.table import EXPERTS, INPUTS
from nst_train.model import GuardMlp

REPORTS = 10
"""How many times in a run `say` gets a line."""


def make_model(settings: Settings, items: list[Item]) -> GuardMlp:
    """A network that reads normalised inputs, and changes the closed form's weights little."""
    torch.manual_seed(settings.seed)
    model = GuardMlp(INPUTS, settings.hidden, EXPERTS, settings.prior_floor)
    mean, spread = normalisation(items)
    model.whiten(mean, torch.diag(1.0 / spread))
    model.start_from_closed(settings.start)
    return model


def train(
    settings: Settings, items: list[Item], say: Callable[[str], None] = print
) -> tuple[GuardMlp, list[float]]:
    """The network, with the normalisation in its first layer, and the loss of each step.

    On a CPU, the same settings and items give the same bits.
    """
    model = make_model(settings, items)
    optimizer = torch.optim.AdamW(
        model.parameters(), lr=settings.learning_rate, weight_decay=settings.weight_decay
    )
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimizer, settings.learning_rate, total_steps=settings.steps
    )
    losses: list[float] = []
    for batch in batches(len(items), settings):
        chosen = [items[i] for i in batch]
        loss = picture_losses(ratios(model, chosen), chosen, settings.loss).mean()
        optimizer.zero_grad()
        loss.backward()
        norm = torch.nn.utils.clip_grad_norm_(model.parameters(), settings.gradient_norm)
        if not norm.isfinite() or not loss.isfinite():
            raise UserError(
                f"training diverged: the loss of step {len(losses) + 1} is {loss.item()}; "
                "lower learning_rate or raise loss.floor"
            )
        optimizer.step()
        schedule.step()
        losses.append(loss.item())
        every = max(1, settings.steps // REPORTS)
        if len(losses) % every == 0:
            say(f"step {len(losses)}/{settings.steps}  loss {sum(losses[-every:]) / every:.4f}")
    return model.folded(), losses


def batches(count: int, settings: Settings) -> Iterator[list[int]]:
    """All items in a random order, again and again, `steps` batches in all."""
    rng = torch.Generator().manual_seed(settings.seed)
    waiting: list[int] = []
    for _ in range(settings.steps):
        while len(waiting) < settings.batch_size:
            waiting += torch.randperm(count, generator=rng).tolist()
        yield waiting[: settings.batch_size]
        del waiting[: settings.batch_size]


def ratios(model: GuardMlp, items: list[Item]) -> Tensor:
    """E_T / best, `[item, metric]`."""
    counts = torch.tensor([len(item.inputs) for item in items])
    of_item = torch.repeat_interleave(torch.arange(len(items)), counts)
    part = torch.stack([item.part for item in items])[of_item, None]
    inputs, closed, forms = (
        torch.cat([getattr(item, name) for item in items]) for name in ("inputs", "closed", "forms")
    )
    weights = model.weights(inputs, closed, part).mean(dim=1)  # [row, expert]
    changes = (forms * monomials(weights)[:, None]).sum(dim=-1)  # [row, metric]
    constants = torch.stack([item.constant for item in items])
    return constants + torch.zeros_like(constants).index_add(0, of_item, changes)


def monomials(weights: Tensor) -> Tensor:
    """What a form is multiplied by, `[row, form]`, for weights `[row, expert]`."""
    pairs = [weights[:, i] * weights[:, j] * (1 if i == j else 2) for i, j in PAIRS]
    return torch.stack([*pairs, *(-2.0 * weights).unbind(dim=1)], dim=1)


def picture_losses(found: Tensor, items: list[Item], loss: Loss) -> Tensor:
    """`[item, metric]` for ratios `[item, metric]`; they can be below 0, as references have noise."""
    plain = torch.stack([item.plain for item in items])
    closed = torch.stack([item.closed_errors for item in items]).clamp_min(0.0)
    ratio = found.clamp_min(0.0)
    harm = torch.log((ratio + 1e-6) / plain).relu()
    known = torch.minimum(closed, plain)
    regret = torch.log((ratio + loss.regret_floor) / (known + loss.regret_floor)).relu()
    return torch.log(ratio + loss.floor) + loss.harm * harm + loss.regret * regret
