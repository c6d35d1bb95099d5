"""The network of section 3.1: a multi-layer perceptron from a window of estimates to T_n."""

from itertools import pairwise

import torch.nn.functional as F
from torch import Tensor, nn

NEGATIVE_SLOPE = 0.01


class Mlp(nn.Module):
    """Fully connected layers, leaky ReLU between them, linear output.

    The names of its parameters, `layers.{i}.weight` and `layers.{i}.bias`, are those of the weights
    file.
    """

    def __init__(self, window: int, hidden: list[int]) -> None:
        super().__init__()
        widths = [window, *hidden, 1]
        self.layers = nn.ModuleList(nn.Linear(i, o) for i, o in pairwise(widths))

    @property
    def window(self) -> int:
        return self.layers[0].in_features

    def forward(self, windows: Tensor) -> Tensor:
        """`[…, window]`, oldest estimate first, to T `[…]`."""
        x = windows
        for layer in self.layers[:-1]:
            x = F.leaky_relu(layer(x), NEGATIVE_SLOPE)
        return self.layers[-1](x).squeeze(-1)
