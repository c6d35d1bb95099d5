"""Networks with random weights, and PyTorch's outputs for them: reference data for the Rust tests.

`python -m nst_train.fixtures FOLDER` rewrites them; with `--check` it compares the stored outputs with
PyTorch's instead. For each network:

- NAME.safetensors: a weights file;
- NAME.io.safetensors: `input` [term, lane], oldest first, f32; `output` [lane] as computed in f32;
  `output_f64` [lane] as computed in f64 from the same f32 weights and inputs.
"""

import argparse
import copy
import sys
from collections.abc import Callable
from pathlib import Path

import torch
from torch import Tensor, nn

from nst_train import weights
from nst_train.errors import UserError, exit_code
from nst_train.model import NEGATIVE_SLOPE, Mlp

WINDOW = 8  # as of the built-in networks
LANES = 101  # a prime: a multiple of no vector width and no workgroup size
NETWORKS: dict[str, list[int]] = {
    "mlp-5-3": [5, 3],
    "mlp-17": [17],
    "mlp-64-64": [64, 64],
    "mlp-32-32-32-32": [32, 32, 32, 32],
}

TOLERANCE = 1e-5
"""Relative to 1 + the lane's largest input. Outputs are of that order, and f32 sums of at most 64
products, taken in any order, agree to about 64 ε = 4e-6 of it."""


def initialise(model: Mlp, seed: int) -> None:
    """He initialisation: hidden units are of the order of the inputs. Biases are small but not zero."""
    rng = torch.Generator().manual_seed(seed)
    for layer in model.layers:
        nn.init.kaiming_normal_(layer.weight, a=NEGATIVE_SLOPE, nonlinearity="leaky_relu", generator=rng)
        nn.init.normal_(layer.bias, std=0.1, generator=rng)


def random_network(hidden: list[int], seed: int) -> Mlp:
    """Outputs are of the order of the inputs."""
    model = Mlp(WINDOW, hidden)
    initialise(model, seed)
    return model


def random_inputs(seed: int) -> Tensor:
    """Progressive means `[term, lane]` of magnitude 1e-3 to 1e3: positive, negative, of both signs."""
    rng = torch.Generator().manual_seed(seed)
    samples = torch.randn(WINDOW, LANES, generator=rng)
    kind = torch.arange(LANES) % 3
    samples = torch.where(kind == 0, samples.abs(), samples)
    samples = torch.where(kind == 1, -samples.abs(), samples)
    magnitude = 10.0 ** (6.0 * torch.rand(LANES, generator=rng) - 3.0)
    counts = torch.arange(1, WINDOW + 1)[:, None]
    return magnitude * samples.cumsum(dim=0) / counts


def outputs(model: Mlp, inputs: Tensor) -> dict[str, Tensor]:
    """What PyTorch computes in f32 and in f64."""
    with torch.no_grad():
        windows = inputs.T.contiguous()
        return {
            "output": model(windows),
            "output_f64": copy.deepcopy(model).double()(windows.double()),
        }


def save_network(
    folder: Path, name: str, model: Mlp, hidden: list[int], samples: tuple[int, int], seed: int
) -> None:
    """Writes a network's weights file; `samples` are the least and the largest n."""
    provenance = weights.Provenance(
        trained_on="fixture:random",
        samples="{}..{}".format(*samples),
        loss="none",
        epochs=0,
        seed=seed,
        config=f'name = "{name}"\nhidden = {hidden}\n',
    )
    weights.save(folder / f"{name}.safetensors", model, provenance)


def compare(path: Path, key: str, computed: Tensor, stored: Tensor, allowed: Tensor) -> None:
    """Raises an error where PyTorch's tensor differs from the stored one by more than is allowed."""
    excess = ((computed - stored).abs() / allowed).max().item()
    if not excess <= 1.0:
        raise UserError(
            f"{path}: {key} is {excess:.3g} times the tolerance away from PyTorch's; "
            "rewrite the fixtures if the network's definition was meant to change"
        )


def write(folder: Path) -> None:
    """Rewrites all fixtures in `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    for seed, (name, hidden) in enumerate(NETWORKS.items(), start=1):
        model = random_network(hidden, seed)
        save_network(folder, name, model, hidden, (WINDOW, WINDOW), seed)
        inputs = random_inputs(seed)
        tensors = {"input": inputs, **outputs(model, inputs)}
        weights.save_tensors(folder / f"{name}.io.safetensors", tensors, {})


def check(folder: Path) -> None:
    """Raises an error where PyTorch's outputs differ from the stored ones."""
    for name in NETWORKS:
        model, _ = weights.load(folder / f"{name}.safetensors")
        path = folder / f"{name}.io.safetensors"
        stored, _ = weights.load_tensors(path)
        missing = {"input", "output", "output_f64"} - stored.keys()
        if missing:
            raise UserError(f"{path}: no tensor {', '.join(sorted(missing))}; rewrite the fixtures")
        allowed = TOLERANCE * (1.0 + stored["input"].abs().amax(dim=0))
        for key, computed in outputs(model, stored["input"]).items():
            compare(path, key, computed, stored[key], allowed)


def run(
    argv: list[str] | None,
    module: str,
    about: str | None,
    write: Callable[[Path], None],
    check: Callable[[Path], None],
) -> int:
    """The command line of a module of fixtures: writes or checks them. Returns the exit code."""
    parser = argparse.ArgumentParser(prog=f"python -m nst_train.{module}", description=about)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--check", action="store_true", help="compare instead of writing")
    arguments = parser.parse_args(argv)
    return exit_code(lambda: check(arguments.folder) if arguments.check else write(arguments.folder))


def main(argv: list[str] | None = None) -> int:
    """`argv` is for tests; without it, the command line. Returns the exit code."""
    return run(argv, "fixtures", __doc__, write, check)


if __name__ == "__main__":
    sys.exit(main())
