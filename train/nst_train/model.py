"""The network of section 3.1: a multi-layer perceptron from a window of estimates to T_n; one that sees the
samples instead; and one that weighs experts."""

import copy
from contextlib import nullcontext
from itertools import pairwise

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from nst_train.power_means import PowerMeans

NEGATIVE_SLOPE = 0.01
"""Of the leaky ReLU: PyTorch's default."""


class Mlp(nn.Module):
    """Fully connected layers, leaky ReLU between them, linear output.

    The names of its parameters, `layers.{i}.weight` and `layers.{i}.bias`, are those of the weights
    file. With `mixed` the products between hidden layers are in bf16. The first layer and the last stay
    in f32: rounding the estimates would erase their differences S_k − S_{k−1}.

    A whitened network reads basis · (window − center). The functions of its first layer are the same, but
    gradient descent is faster; `folded` returns the plain weights.
    """

    center: Tensor | None
    basis: Tensor | None

    def __init__(self, window: int, hidden: list[int], outputs: int = 1) -> None:
        super().__init__()
        self.mixed = False
        self.register_buffer("center", None)
        self.register_buffer("basis", None)
        widths = [window, *hidden, outputs]
        self.layers = nn.ModuleList(nn.Linear(i, o) for i, o in pairwise(widths))

    @property
    def window(self) -> int:
        return self.layers[0].in_features

    def whiten(self, center: Tensor, basis: Tensor) -> None:
        """Makes the first layer read basis · (window − center), of shapes `[window]` and
        `[window, window]`, with the weights that it has."""
        self.center, self.basis = center.float(), basis.float()

    def folded(self) -> "Mlp":
        """The same network with the whitening in the weights of its first layer."""
        plain = copy.deepcopy(self)
        plain.mixed = False
        if self.basis is not None and self.center is not None:
            first = plain.layers[0]
            with torch.no_grad():
                weight = first.weight.double() @ self.basis.double()
                first.bias -= (weight @ self.center.double()).float()
                first.weight.copy_(weight)
            plain.center = plain.basis = None
        return plain

    def start_from_input(self) -> None:
        """Sets T = S_n (for S_n ≥ 0): unit 0 of each layer hands S_n on, and the last layer ignores the
        others, which stay as they are."""
        with torch.no_grad():
            last = self.layers[-1]
            last.weight.zero_()
            last.bias.zero_()
            for index, layer in enumerate(self.layers):
                layer.weight[0] = 0.0
                layer.bias[0] = 0.0
                layer.weight[0, -1 if index == 0 else 0] = 1.0
            if self.basis is not None and self.center is not None:
                self.layers[0].weight[0] = torch.linalg.inv(self.basis.double())[-1].float()
                self.layers[0].bias[0] = self.center[-1]

    def forward(self, windows: Tensor) -> Tensor:
        """`[…, window]`, oldest estimate first, to T `[…]`; to `[…, output]`, if there are several."""
        first, *between, last = self.layers
        if self.basis is not None:
            windows = (windows - self.center) @ self.basis.T
        x = F.leaky_relu(first(windows), NEGATIVE_SLOPE)
        lower = torch.autocast(windows.device.type, torch.bfloat16) if self.mixed else nullcontext()
        with lower:
            for layer in between:
                x = F.leaky_relu(layer(x), NEGATIVE_SLOPE)
        return last(x.to(last.weight.dtype)).squeeze(-1)


class SampleMlp(Mlp):
    """A network that sees the samples: its inputs are those of `power_means`, and its output o changes S."""

    def __init__(self, form: PowerMeans, hidden: list[int], trained: tuple[int, int]) -> None:
        """`trained` are the least and the largest n of training."""
        super().__init__(form.width, hidden)
        self.form = form
        self.trained = trained

    def inputs(self, sums: Tensor, n: Tensor, unit: Tensor) -> Tensor:
        """`[…, input]` of the first layer, in the type of the sums `[power, …]`."""
        return self.form.inputs(sums, n, unit, self.trained)

    def start_from_input(self) -> None:
        """Sets T = S: o = 0."""
        with torch.no_grad():
            self.layers[-1].weight.zero_()
            self.layers[-1].bias.zero_()

    def transform(self, sums: Tensor, n: Tensor, unit: Tensor) -> Tensor:
        """T `[…]` of sums `[power, …]`; n and u broadcast with `[…]`.

        Inputs, S and T have the type of the sums; the layers compute in the type of their weights.
        """
        estimate = self.form.estimate(sums, n)
        inputs = self.inputs(sums, n, unit)
        output = self(inputs.to(self.layers[0].weight.dtype)).to(sums.dtype)
        return estimate + self.form.scale(estimate, unit) * output


class GuardMlp(Mlp):
    """Corrects the weights that the guard's closed form gives each expert (`guard_training/table.py`).

    With the closed form's weights c, what is left for S among them, and the network's outputs o,

        w = softmax over S and the experts that take part of (o + ln(c + floor)),    o of S = 0
    """

    def __init__(self, inputs: int, hidden: list[int], experts: tuple[str, ...], floor: float) -> None:
        super().__init__(inputs, hidden, outputs=len(experts))
        self.experts = experts
        self.floor = floor

    def start_from_closed(self, share: float) -> None:
        """Makes the outputs small: the last layer's weights are multiplied by `share`, its biases are 0."""
        with torch.no_grad():
            self.layers[-1].weight.mul_(share)
            self.layers[-1].bias.zero_()

    def weights(self, inputs: Tensor, closed: Tensor, part: Tensor) -> Tensor:
        """`[…, expert]` of inputs `[…, input]` and the closed form's weights `[…, expert]`.

        `part` broadcasts with these and says who takes part; the others get 0.
        """
        left = (1.0 - closed.sum(dim=-1, keepdim=True)).clamp_min(0.0)
        logits = self(inputs) + torch.log(closed + self.floor)
        logits = logits.masked_fill(~part, -torch.inf)
        return torch.softmax(torch.cat([torch.log(left + self.floor), logits], dim=-1), dim=-1)[..., 1:]
