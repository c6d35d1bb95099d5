"""Random networks that correct the guard's weights, and what PyTorch makes of them: data for the Rust tests.

`python -m nst_train.guard_fixtures FOLDER` rewrites them; with `--check` it compares the stored weights with
PyTorch's instead. For each network:

- NAME.safetensors: a weights file;
- NAME.io.safetensors, of `ROWS` rows: `inputs` [row, input] and `closed` [row, expert], f32, the closed
  form's weights; and for each of `LISTS`, as `lane-filter`, `weights-LIST` [row, expert] as computed in f32
  and `weights_f64-LIST` in f64 from the same f32 numbers, of the experts in the list, in the network's order.
  An expert that is not in the list has no part in `closed` then: its column counts as 0, and as S's.
"""

import copy
import sys
from pathlib import Path

import torch
from torch import Tensor

from nst_train import weights
from nst_train.errors import UserError
from nst_train.fixtures import compare, initialise, run, save_network
from nst_train.guard_training.table import EXPERTS, INPUTS
from nst_train.model import GuardMlp

ROWS = 50
LISTS = (("lane", "filter", "oidn"), ("lane", "filter"), ("filter", "oidn"), ("oidn",))
NETWORKS = {"guard-16-16": ([16, 16], 0.02), "guard-5": ([5], 0.1)}
"""By name: hidden widths, and what is added to the closed form's weights."""

TOLERANCE = 1e-5
"""Absolute: weights are at most 1. Logits are sums of at most 18 products of the order of 1, which agree to
about 18 ε = 2e-6 in f32 in any order, and weights change by at most a quarter of that."""


def random_network(hidden: list[int], floor: float, seed: int) -> GuardMlp:
    """Outputs are of the order of 1, which multiplies weights by some e."""
    model = GuardMlp(INPUTS, hidden, EXPERTS, floor)
    initialise(model, seed)
    return model


def random_rows(seed: int) -> tuple[Tensor, Tensor]:
    """Inputs, and weights of the closed form: any on the simplex, some of them 0, or all, or together 1."""
    rng = torch.Generator().manual_seed(seed)
    inputs = torch.randn(ROWS, INPUTS, generator=rng)
    inputs[-1] = 0.0  # as where nothing is near
    shares = torch.rand(ROWS, len(EXPERTS) + 1, generator=rng).log().neg()
    shares = shares * (torch.rand(ROWS, len(EXPERTS) + 1, generator=rng) < 0.7)
    shares[:, 0] += (shares.sum(dim=1) == 0).float()
    closed = shares[:, 1:] / shares.sum(dim=1, keepdim=True)
    return inputs, closed


def outputs(model: GuardMlp, inputs: Tensor, closed: Tensor) -> dict[str, Tensor]:
    """What PyTorch computes in f32 and in f64."""
    found = {}
    exact = copy.deepcopy(model).double()
    for names in LISTS:
        part = torch.tensor([name in names for name in model.experts])
        among = closed * part
        with torch.no_grad():
            found[f"weights-{'-'.join(names)}"] = model.weights(inputs, among, part)[:, part]
            in_f64 = exact.weights(inputs.double(), among.double(), part)
        found[f"weights_f64-{'-'.join(names)}"] = in_f64[:, part]
    return {name: tensor.contiguous() for name, tensor in found.items()}


def write(folder: Path) -> None:
    """Rewrites all fixtures in `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    for seed, (name, (hidden, floor)) in enumerate(NETWORKS.items(), start=1):
        model = random_network(hidden, floor, seed)
        save_network(folder, name, model, hidden, (8, 1024), seed)
        inputs, closed = random_rows(seed)
        tensors = {"inputs": inputs, "closed": closed, **outputs(model, inputs, closed)}
        weights.save_tensors(folder / f"{name}.io.safetensors", tensors, {})


def check(folder: Path) -> None:
    """Raises an error where PyTorch's weights differ from the stored ones."""
    for name in NETWORKS:
        model, _ = weights.load(folder / f"{name}.safetensors")
        path = folder / f"{name}.io.safetensors"
        stored, _ = weights.load_tensors(path)
        if not isinstance(model, GuardMlp) or not {"inputs", "closed"} <= stored.keys():
            raise UserError(f"{path}: no inputs, or a network of another kind; rewrite the fixtures")
        for key, computed in outputs(model, stored["inputs"], stored["closed"]).items():
            if key not in stored:
                raise UserError(f"{path}: no tensor {key}; rewrite the fixtures")
            compare(path, key, computed, stored[key], torch.tensor(TOLERANCE))


def main(argv: list[str] | None = None) -> int:
    """`argv` is for tests; without it, the command line. Returns the exit code."""
    return run(argv, "guard_fixtures", __doc__, write, check)


if __name__ == "__main__":
    sys.exit(main())
