"""Random networks that see the samples, and PyTorch's outputs for them: reference data for the Rust tests.

`python -m nst_train.sample_fixtures FOLDER` rewrites them; with `--check` it compares the stored outputs
with PyTorch's instead. `power_means.py` defines the inputs. For each network:

- NAME.safetensors: a weights file;
- NAME.io.safetensors, of `LANES` lanes that are one batch, with n samples each: `samples` [sample, lane],
  f32; `sums` [power, lane], f64, of all samples, in order; `unit` [1], f64; `inputs` [input, lane] of the
  first layer, f64; `output` [lane], T with layers in f32; `output_f64` [lane], T with layers in f64, from
  the same inputs rounded to f32. `part_sums`, `part_unit` and `part_output_f64` are the same without the
  samples i with i mod 4 = 1, as for a network that must not see fold 1.
"""

import copy
import sys
from pathlib import Path

import torch
from torch import Tensor

from nst_train import weights
from nst_train.errors import UserError
from nst_train.fixtures import compare, initialise, run, save_network
from nst_train.model import SampleMlp
from nst_train.power_means import PowerMeans

LANES = 101  # a prime: a multiple of no vector width and no workgroup size
LEFT_OUT = 1  # the fold that the second output does not see

NETWORKS: dict[str, tuple[PowerMeans, list[int], tuple[int, int], int]] = {
    "samples-integrals": (
        PowerMeans([0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0], 1e-3, 0.0, 1.0),
        [32, 32, 32],
        (4, 64),
        32,
    ),
    "samples-pixels": (PowerMeans([0.5, 1.0, 2.0], 1e-2, 1.0, 1e-2), [17, 5], (4, 1024), 13),
    "samples-few": (PowerMeans([1.0, 2.0], 1e-3, 0.0, 1.0), [64], (16, 64), 8),
    "samples-many": (PowerMeans([0.5, 1.0], 1e-3, 0.0, 1.0), [24, 8], (4, 16), 40),
}
"""By name: the form of the inputs, hidden widths, the n that it is said to be trained on, and n."""

TOLERANCE = 1e-5
"""Relative to |S| + u: outputs are of that order, and f32 sums of at most 64 products, taken in any
order, agree to about 64 ε = 4e-6 of it."""


def random_network(form: PowerMeans, hidden: list[int], trained: tuple[int, int], seed: int) -> SampleMlp:
    """Outputs are of the order of a tenth of the inputs."""
    model = SampleMlp(form, hidden, trained)
    initialise(model, seed)
    with torch.no_grad():  # changes of S that are of its order: inputs are up to 7, L of a dark lane
        model.layers[-1].weight.mul_(0.1)
    return model


def random_samples(n: int, seed: int) -> Tensor:
    """`[sample, lane]`, f32, whose lanes' means are from 0.01 to 100. One in six lanes has samples of both
    signs, one in six is mostly 0, and two are all 0."""
    rng = torch.Generator().manual_seed(seed)
    samples = torch.randn(n, LANES, generator=rng).exp()
    kind = torch.arange(LANES) % 6
    signs = torch.where(torch.rand(n, LANES, generator=rng) < 0.4, -1.0, 1.0)
    samples = torch.where(kind == 0, signs * samples, samples)
    dark = torch.rand(n, LANES, generator=rng) < 0.8
    samples = torch.where((kind == 1) & dark, 0.0, samples)
    samples = samples * 10.0 ** (4.0 * torch.rand(LANES, generator=rng) - 2.0)
    samples[:, [0, LANES - 1]] = 0.0
    return samples


def outputs(model: SampleMlp, samples: Tensor) -> dict[str, Tensor]:
    """All that a fixture contains beside the samples."""
    lanes = samples.double()
    part = lanes[torch.arange(len(lanes)) % 4 != LEFT_OUT]
    exact = copy.deepcopy(model).double()
    with torch.no_grad():
        sums, n, unit = batch(model.form, lanes)
        found = {"sums": sums, "unit": unit[None], "inputs": model.inputs(sums, n, unit).T}
        found["output"] = model.transform(sums, n, unit).float()
        found["output_f64"] = in_f64(exact, sums, n, unit)
        sums, n, unit = batch(model.form, part)
        found |= {"part_sums": sums, "part_unit": unit[None]}
        found["part_output_f64"] = in_f64(exact, sums, n, unit)
    return found


def batch(form: PowerMeans, samples: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Sums, n and unit of all samples `[sample, lane]`, in f64."""
    sums = form.features(samples).sum(dim=1)
    n = torch.tensor(len(samples), dtype=torch.float64)
    return sums, n, form.estimate(sums, n).abs().mean()


def in_f64(exact: SampleMlp, sums: Tensor, n: Tensor, unit: Tensor) -> Tensor:
    """T with layers in f64 of inputs in f32, which are what the layers get."""
    estimate = exact.form.estimate(sums, n)
    output = exact(exact.inputs(sums, n, unit).float().double())
    return estimate + exact.form.scale(estimate, unit) * output


def write(folder: Path) -> None:
    """Rewrites all fixtures in `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    for seed, (name, (form, hidden, trained, n)) in enumerate(NETWORKS.items(), start=1):
        model = random_network(form, hidden, trained, seed)
        save_network(folder, name, model, hidden, trained, seed)
        samples = random_samples(n, seed)
        tensors = {"samples": samples, **outputs(model, samples)}
        weights.save_tensors(folder / f"{name}.io.safetensors", tensors, {})


def check(folder: Path) -> None:
    """Raises an error where PyTorch's outputs differ from the stored ones."""
    for name in NETWORKS:
        model, _ = weights.load(folder / f"{name}.safetensors")
        path = folder / f"{name}.io.safetensors"
        stored, _ = weights.load_tensors(path)
        if not isinstance(model, SampleMlp) or "samples" not in stored:
            raise UserError(f"{path}: no samples, or a network that sees none; rewrite the fixtures")
        for key, computed in outputs(model, stored["samples"]).items():
            if key not in stored:
                raise UserError(f"{path}: no tensor {key}; rewrite the fixtures")
            size = computed.abs()
            if "output" in key:
                size = stored["samples"].double().mean(dim=0).abs() + stored["unit"]
            compare(path, key, computed, stored[key], TOLERANCE * size.clamp_min(1e-30))


def main(argv: list[str] | None = None) -> int:
    """`argv` is for tests; without it, the command line. Returns the exit code."""
    return run(argv, "sample_fixtures", __doc__, write, check)


if __name__ == "__main__":
    sys.exit(main())
