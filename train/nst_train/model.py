"""The network of section 3.1: a multi-layer perceptron from a window of estimates to T_n."""

from contextlib import nullcontext
from itertools import pairwise

import torch
import torch.nn.functional as F
from torch import Tensor, nn

NEGATIVE_SLOPE = 0.01


class Mlp(nn.Module):
    """Fully connected layers, leaky ReLU between them, linear output.

    The names of its parameters, `layers.{i}.weight` and `layers.{i}.bias`, are those of the weights
    file. With `mixed` the products between hidden layers are in bf16. The first layer and the last stay
    in f32: rounding the estimates would erase their differences S_k − S_{k−1}.
    """

    def __init__(self, window: int, hidden: list[int]) -> None:
        super().__init__()
        self.mixed = False
        widths = [window, *hidden, 1]
        self.layers = nn.ModuleList(nn.Linear(i, o) for i, o in pairwise(widths))

    @property
    def window(self) -> int:
        return self.layers[0].in_features

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

    def forward(self, windows: Tensor) -> Tensor:
        """`[…, window]`, oldest estimate first, to T `[…]`."""
        first, *between, last = self.layers
        x = F.leaky_relu(first(windows), NEGATIVE_SLOPE)
        lower = torch.autocast(windows.device.type, torch.bfloat16) if self.mixed else nullcontext()
        with lower:
            for layer in between:
                x = F.leaky_relu(layer(x), NEGATIVE_SLOPE)
        return last(x.to(last.weight.dtype)).squeeze(-1)
