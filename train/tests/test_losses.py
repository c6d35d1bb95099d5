"""The losses of equation 9 against values worked out by hand, and their gradients."""

import math

import pytest
import torch

from nst_train.losses import LOSSES, sequence_loss

# One integrand, n = 8 and 16. E_T and E_S are powers of e^-log(n), so that the roots are exact:
# E_T = n^-2 has the log(n)-th root e^-2.
N = torch.tensor([8, 16])
E_T = torch.tensor([[8.0**-2, 16.0**-2]], dtype=torch.float64)
E_S = torch.tensor([[0.24, 0.09]], dtype=torch.float64)
EPSILON = 0.01

EXPECTED = {
    "L0": [1 / 64, 1 / 256],
    "L1": [(1 / 64) / 0.25, (1 / 256) / 0.10],
    "L2": [math.exp(-2) / 0.25, math.exp(-2) / 0.10],
    "L3": [math.exp(-2), math.exp(-2)],
}


@pytest.mark.parametrize("loss", LOSSES)
def test_value_matches_hand_computation(loss: str) -> None:
    computed = LOSSES[loss](E_T, E_S, N, EPSILON)
    torch.testing.assert_close(computed, torch.tensor([EXPECTED[loss]], dtype=torch.float64))


@pytest.mark.parametrize("loss", LOSSES)
def test_expected_values_tell_the_losses_apart(loss: str) -> None:
    """A wrong formula fails the test above: no other loss has these values."""
    expected = torch.tensor([EXPECTED[loss]], dtype=torch.float64)
    for other in LOSSES.keys() - {loss}:
        computed = LOSSES[other](E_T, E_S, N, EPSILON)
        assert ((computed - expected).abs() > 0.1 * expected).all()


@pytest.mark.parametrize("loss", LOSSES)
def test_sequence_loss_sums_over_n_and_averages_over_integrands(loss: str) -> None:
    e_t, e_s = torch.cat([E_T, 4 * E_T]), torch.cat([E_S, E_S])
    first, second = (LOSSES[loss](e_t[i : i + 1], E_S, N, EPSILON).sum() for i in (0, 1))
    total = sequence_loss(loss, e_t, e_s, N, EPSILON)
    torch.testing.assert_close(total, (first + second) / 2)


@pytest.mark.parametrize("loss", LOSSES)
def test_gradient_matches_finite_differences(loss: str) -> None:
    e_t = torch.tensor([[0.02, 0.003], [0.4, 1.7]], dtype=torch.float64, requires_grad=True)
    e_s = torch.tensor([[0.1, 0.05], [0.2, 0.1]], dtype=torch.float64)
    assert torch.autograd.gradcheck(lambda e: sequence_loss(loss, e, e_s, N, EPSILON), e_t)


@pytest.mark.parametrize("loss", LOSSES)
def test_perfect_estimates_give_finite_loss_and_gradient(loss: str) -> None:
    t = torch.ones(1, 3, 2, requires_grad=True)
    e_t = (t - 1.0).square().mean(dim=1)
    value = sequence_loss(loss, e_t, torch.zeros_like(e_t), N, EPSILON)
    value.backward()
    assert value.isfinite()
    assert (t.grad == 0.0).all()
