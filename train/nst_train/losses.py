"""The four losses of equation 9.

They take E_T and E_S, the squared errors averaged over runs (equations 3 and 4), of shape
`[integrand, n]`, and give the loss of each point of each sequence.
"""

from collections.abc import Callable

import torch
from torch import Tensor

MIN_ERROR = 1e-12
"""E_T below this counts as this, and passes no gradient: the slope of a root is infinite at 0."""

Loss = Callable[[Tensor, Tensor, Tensor, float], Tensor]


def l0(e_t: Tensor, e_s: Tensor, n: Tensor, epsilon: float) -> Tensor:
    """The mean squared error."""
    return e_t


def l1(e_t: Tensor, e_s: Tensor, n: Tensor, epsilon: float) -> Tensor:
    """The mean squared error relative to the input's."""
    return e_t / (e_s + epsilon)


def l2(e_t: Tensor, e_s: Tensor, n: Tensor, epsilon: float) -> Tensor:
    """The paper's proposal, equation 5."""
    return l3(e_t, e_s, n, epsilon) / (e_s + epsilon)


def l3(e_t: Tensor, e_s: Tensor, n: Tensor, epsilon: float) -> Tensor:
    """The log(n)-th root of the mean squared error."""
    return e_t.clamp_min(MIN_ERROR).pow(1.0 / torch.log(n.to(e_t.dtype)))


LOSSES: dict[str, Loss] = {"L0": l0, "L1": l1, "L2": l2, "L3": l3}


def sequence_loss(loss: str, e_t: Tensor, e_s: Tensor, n: Tensor, epsilon: float) -> Tensor:
    """Equation 6: the sum over n, averaged over the integrands; a scalar."""
    return LOSSES[loss](e_t, e_s, n, epsilon).sum(dim=1).mean()
