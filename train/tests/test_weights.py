"""The weights file, its metadata, and the fixtures made of them."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from nst_train import fixtures, weights
from nst_train.errors import UserError
from nst_train.model import Mlp

PROVENANCE = weights.Provenance(
    trained_on="family:step", samples="8..64", loss="L2", epochs=3, seed=1, config="name = 'x'\n"
)


def test_round_trip(tmp_path: Path) -> None:
    model = Mlp(8, [5, 3])
    path = tmp_path / "x.safetensors"
    weights.save(path, model, PROVENANCE)
    loaded, metadata = weights.load(path)

    assert metadata == {
        "format": "nst-weights-1",
        "kind": "mlp",
        "window": "8",
        "inputs": "window",
        "activation": "leaky_relu",
        "negative_slope": "0.01",
        "trained_on": "family:step",
        "samples": "8..64",
        "loss": "L2",
        "epochs": "3",
        "seed": "1",
        "config": "name = 'x'\n",
    }
    tensors, _ = weights.load_tensors(path)
    assert {name: tuple(tensor.shape) for name, tensor in tensors.items()} == {
        "layers.0.weight": (5, 8),
        "layers.0.bias": (5,),
        "layers.1.weight": (3, 5),
        "layers.1.bias": (3,),
        "layers.2.weight": (1, 3),
        "layers.2.bias": (1,),
    }
    assert all(tensor.dtype == torch.float32 for tensor in tensors.values())
    x = torch.randn(10, 8)
    assert torch.equal(loaded(x), model(x))


def test_half_precision_and_sampler(tmp_path: Path) -> None:
    """The file holds what `rounded` computes with, and half as many bytes of numbers."""
    model, path = Mlp(8, [32]), tmp_path / "x.safetensors"
    weights.save(path, model, replace(PROVENANCE, sampler="halton"), torch.float16)
    loaded, metadata = weights.load(path)
    assert metadata["sampler"] == "halton"
    tensors, _ = weights.load_tensors(path)
    assert all(tensor.dtype == torch.float16 for tensor in tensors.values())
    x = torch.randn(10, 8)
    assert torch.equal(loaded(x), weights.rounded(model, torch.float16)(x))
    assert not torch.equal(loaded(x), model(x))


def test_same_network_gives_same_bytes(tmp_path: Path) -> None:
    model = Mlp(8, [4])
    for name in ("a", "b"):
        weights.save(tmp_path / name, model, PROVENANCE)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_network_is_the_one_described() -> None:
    """Two layers by hand: leaky ReLU of slope 0.01 between them, none after the last."""
    model = Mlp(2, [2])
    with torch.no_grad():
        model.layers[0].weight.copy_(torch.tensor([[1.0, 0.0], [0.0, 1.0]]))
        model.layers[0].bias.copy_(torch.tensor([0.5, 0.0]))
        model.layers[1].weight.copy_(torch.tensor([[2.0, 100.0]]))
        model.layers[1].bias.copy_(torch.tensor([-10.0]))
    # hidden = (1.5, -3) → (1.5, -0.03); T = 3 - 3 - 10
    torch.testing.assert_close(model(torch.tensor([1.0, -3.0])), torch.tensor(-10.0))


def test_a_network_can_start_from_its_input() -> None:
    """T = S_n, and the other units still get gradients through the last layer."""
    model = Mlp(4, [6, 5])
    model.start_from_input()
    x = torch.rand(10, 4)
    assert torch.equal(model(x), x[:, -1])
    (model(x) - 0.5).square().sum().backward()
    assert (model.layers[-1].weight.grad != 0).sum() > 1


def test_bad_files_are_named(tmp_path: Path) -> None:
    path = tmp_path / "x.safetensors"
    with pytest.raises(UserError, match="no such file"):
        weights.load(path)
    path.write_bytes(b"not a header")
    with pytest.raises(UserError, match="not a safetensors file"):
        weights.load(path)
    weights.save_tensors(path, {"x": torch.zeros(1)}, {})
    with pytest.raises(UserError, match="format is None"):
        weights.load(path)

    state = Mlp(8, [4]).state_dict()
    metadata = {"format": weights.FORMAT, "window": "7"}
    weights.save_tensors(path, state, metadata)
    with pytest.raises(UserError, match="do not fit"):
        weights.load(path)
    state["layers.0.bias"] = torch.full((4,), torch.nan)
    weights.save_tensors(path, state, metadata)
    with pytest.raises(UserError, match="NaN"):
        weights.load(path)


def test_fixtures_agree_with_pytorch_and_a_change_is_noticed(tmp_path: Path) -> None:
    fixtures.write(tmp_path)
    fixtures.check(tmp_path)

    path = tmp_path / "mlp-17.io.safetensors"
    tensors, metadata = weights.load_tensors(path)
    allowed = fixtures.TOLERANCE * (1.0 + tensors["input"][:, 0].abs().max())
    tensors["output"][0] += 3 * allowed
    weights.save_tensors(path, tensors, metadata)
    with pytest.raises(UserError, match="mlp-17.io.safetensors: output is"):
        fixtures.check(tmp_path)


def test_fixture_inputs_are_varied() -> None:
    inputs = fixtures.random_inputs(seed=1)
    assert inputs.shape == (fixtures.WINDOW, fixtures.LANES)
    assert (inputs > 0).all(dim=0).sum() > 20 and (inputs < 0).all(dim=0).sum() > 20
    largest = inputs.abs().amax(dim=0)
    assert largest.min() < 1e-2 and largest.max() > 1e2
