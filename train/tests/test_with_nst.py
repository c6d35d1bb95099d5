"""Python and the real `nst` binary agree on files: sequences, weights, and what a network makes of them."""

import subprocess
from pathlib import Path

import numpy as np
import OpenEXR
import torch

from nst_train import renders, sequence_file, training, weights
from nst_train.config import RendersData
from nst_train.config import load as load_config

SCENE = "scenes/cornell/cornell.obj"
CONFIG = Path(__file__).resolve().parents[1] / "configs" / "cornell.toml"


def nst(*arguments: object) -> None:
    subprocess.run([renders.renderer(), *map(str, arguments)], check=True, capture_output=True)


def test_a_fresh_network_gives_the_same_picture_in_pytorch_and_nst(tmp_path: Path) -> None:
    data = RendersData("renders", SCENE, [12, 10], 2, 1, 10, 32, 1)
    cornell = renders.make_data(data, tmp_path)
    assert cornell.trained_on.startswith("scene:cornell:")
    assert cornell.training.estimates.shape[1:] == (2, 10)

    model = training.make_model(load_config(CONFIG))
    provenance = weights.Provenance(cornell.trained_on, "8..10", "L2", 0, 1, "")
    weights.save(tmp_path / "fresh.safetensors", model, provenance)
    sequence, picture = tmp_path / "sequence.exr", tmp_path / "picture.exr"
    size = ("--size", "12x10", "--spp", 10, "--seed", 7)
    nst(*("render", "--scene", renders.REPOSITORY / SCENE, *size, "--keep", "all"),
        *("--sequence", sequence, "-o", tmp_path / "plain.exr", "--transform", "none"))
    nst("transform", sequence, "--weights", tmp_path / "fresh.safetensors", "-o", picture,
        "--backend", "cpu")

    estimates = torch.from_numpy(sequence_file.read(sequence, (12, 10)).terms(10))
    window = estimates[:, 2:]
    with torch.no_grad():
        expected = model.double()(window.double())
    constant = (window == window[:, :1]).all(dim=1)  # nst leaves S_n there
    expected[constant] = window[constant, -1].double()

    actual = torch.from_numpy(read_picture(picture))
    assert 0 < constant.sum() < len(constant) / 2
    # f32 rounding, as in the agreement tests of the Rust side; outputs are of the order of 0.1.
    assert (actual - expected).abs().max() < 1e-5 * expected.abs().max()


def read_picture(path: Path) -> np.ndarray:
    """The R, G, B of an EXR picture, as lanes."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = file.channels()
        return np.concatenate([channels[name].pixels.ravel() for name in "RGB"])
