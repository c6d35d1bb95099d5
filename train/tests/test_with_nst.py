"""Python and the real `nst` binary agree on files: datasets, weights, and what a network makes of them."""

import subprocess
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
import torch

from nst_train import binary, random_scenes, renders, scene_renders, training, weights
from nst_train.config import RandomScenesData, RendersData
from nst_train.config import load as load_config
from nst_train.guard_data import make as guard_make
from nst_train.guard_data import read as guard_read
from nst_train.guard_data.plan import plan as guard_plan
from nst_train.power_means import PowerMeans
from nst_train.random_scenes import BRANCHES

SCENE = "scenes/cornell/cornell.obj"
CONFIG = Path(__file__).resolve().parents[1] / "configs" / "cornell.toml"
SIZE = [12, 10]
SEED = 7


def nst(*arguments: object) -> None:
    subprocess.run([binary.renderer(), *map(str, arguments)], check=True, capture_output=True)


def dataset(**changed: object) -> RendersData:
    fixed = {"kind": "renders", "scene": SCENE, "size": SIZE, "runs": 2, "evaluation_runs": 1, "terms": 10}
    varied = {"reference_spp": 32, "first_seed": SEED, "sampler": "random", "max_depth": 8, "pixel": "box"}
    return RendersData(**(fixed | varied | changed))


@pytest.mark.parametrize("dtype", [torch.float32, torch.float16])
def test_a_fresh_network_gives_the_same_picture_in_pytorch_and_nst(
    tmp_path: Path, dtype: torch.dtype
) -> None:
    cornell = renders.load(dataset(), tmp_path)
    assert cornell.scene.startswith("cornell:")
    assert cornell.estimates.shape == (3 * 12 * 10, 3, 10)

    config = load_config(CONFIG)
    model = training.make_model(config, torch.from_numpy(cornell.estimates))
    provenance = weights.Provenance(f"scene:{cornell.scene}", "8..10", "L2", 0, 1, "", "random")
    path = tmp_path / "fresh.safetensors"
    weights.save(path, model, provenance, dtype)
    sequence, picture = tmp_path / "sequence.exr", tmp_path / "picture.exr"
    size = ("--size", "12x10", "--spp", 10, "--seed", SEED)
    nst(
        *("render", "--scene", renders.REPOSITORY / SCENE, *size),
        *("--sequence", sequence, "-o", tmp_path / "plain.exr", "--transform", "none"),
    )
    nst("transform", sequence, "--weights", path, "-o", picture, "--backend", "cpu")

    # Run 0 has the seed of the sequence.
    window = torch.from_numpy(cornell.estimates[:, 0, 2:])
    with torch.no_grad():
        expected = weights.rounded(model, dtype).double()(window.double())
        unrounded = model.double()(window.double())
    constant = (window == window[:, :1]).all(dim=1)  # nst leaves S_n there
    for values in (expected, unrounded):
        values[constant] = window[constant, -1].double()

    actual = torch.from_numpy(read_picture(picture))
    assert 0 < constant.sum() < len(constant) / 2
    # f32 rounding, as in the agreement tests of the Rust side; outputs are of the order of 0.1.
    tolerance = 1e-5 * expected.abs().max()
    assert (actual - expected).abs().max() < tolerance
    if dtype == torch.float16:
        assert (actual - unrounded).abs().max() > tolerance


def test_samplers_depths_and_filters_are_different_data(tmp_path: Path) -> None:
    plain = renders.load(dataset(), tmp_path)
    for change in ({"sampler": "halton"}, {"max_depth": 2}, {"pixel": "center"}):
        other = renders.load(dataset(**change), tmp_path)
        assert not np.array_equal(other.estimates, plain.estimates)
        assert (other.scene == plain.scene) == ("sampler" in change)


def test_grey_scenes_have_one_channel(tmp_path: Path) -> None:
    plane = dataset(scene="scenes/plane-lambert/plane-lambert.obj", max_depth=2)
    assert renders.load(plane, tmp_path).estimates.shape == (12 * 10, 3, 10)


@pytest.mark.parametrize("branch", BRANCHES)
def test_random_scenes_are_rendered_without_faults(tmp_path: Path, branch: str) -> None:
    """`--strict` refuses what a note would forgive; and sums are those of the samples of the picture."""
    scene = random_scenes.random_scene(branch, 0, seed=1)
    path = random_scenes.write(scene, tmp_path)
    options = ("--size", "8x6", "--spp", 16, "--seed", SEED, "--transform", "none", "--strict")
    nst("render", "--scene", path, *options, "-o", tmp_path / "picture.exr")
    picture = torch.from_numpy(read_picture(tmp_path / "picture.exr"))

    form = PowerMeans([0.5, 1.0, 2.0], floor=0.01, scale_estimate=1.0, scale_unit=0.01)
    asked = {"branches": [branch], "scenes": 1, "held_out": [], "held_out_scenes": 0, "families": []}
    rest = {"size": [8, 6], "runs": 1, "terms": 16, "reference_spp": 64, "first_seed": SEED}
    data = RandomScenesData("random-scenes", **asked, **rest, family_share=0.0, batches=1)
    arrays = scene_renders.render(scene, data, form)
    means = torch.from_numpy(arrays["16"][0]).sum(dim=0) / 16  # [power, lane]
    # Pictures in EXR are f32, or f16 for colours: 1/2048.
    torch.testing.assert_close(means[1], picture.float(), rtol=1e-3, atol=1e-6)
    # Dust, sparks and wires are in the black.
    is_sparse = BRANCHES[branch].__module__.endswith(".sparse")
    lit, seen = (0.0, 0.0) if is_sparse else (0.1, 0.3)
    assert (means[1] > 0).float().mean() > lit
    reference = arrays["reference"].mean(axis=0)
    # Without what a small lamp adds to the pixels that meet it.
    most = 5 * np.median(reference[reference > 0] if is_sparse else reference)
    clipped = means[1].clamp(max=most).mean().item()
    assert np.minimum(reference, most).mean() == pytest.approx(clipped, rel=0.8)
    assert (reference > 1e-3 * reference.mean()).mean() > seen


def test_the_set_for_the_guard_is_what_nst_reads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two scenes, tiny pictures: means over folds are the sequence's, and both halves agree with them."""
    monkeypatch.setattr(guard_make, "STAGES", ((3, 128), (4, 256)))
    monkeypatch.setattr(guard_make, "PIECE", 64)
    plans = [guard_plan("room", 0), guard_plan("blinds", 1)]
    for plan, stage in [(plan, stage) for stage in (0, 1) for plan in plans]:
        if stage == 1:  # a second call continues
            assert not guard_make.make_stage(plan, 0, tmp_path, (16, 12), 1e6)
        assert guard_make.make_stage(plan, stage, tmp_path, (16, 12), 1e6)
    found = list(guard_read.pictures(tmp_path))
    assert [(p.scene, p.spp) for p in found] == [
        (plan.name, spp) for plan in reversed(plans) for spp in sorted(plan.counts)
    ]
    assert [p.held_out for p in found] == [True] * 4 + [False] * 4
    for p in found:
        assert p.reference_spp == 256
        with OpenEXR.File(str(p.sequence), separate_channels=True) as file:
            channels = {name: channel.pixels for name, channel in file.channels().items()}
        folds = np.mean([channels[f"fold{i}.R"] for i in range(4)], axis=0)
        np.testing.assert_allclose(folds, channels["R"], rtol=1e-5, atol=1e-7)
        assert {"albedo3.R", "normal0.X", "depth.Z", "emission2.B", "square1.G", "root1.G"} <= set(channels)
        first, second = p.halves()
        assert first.mean() == pytest.approx(second.mean(), rel=0.5) and not np.array_equal(first, second)
        picture = tmp_path / "guarded.exr"
        nst("transform", p.sequence, "--experts", "lane,filter", "-o", picture, "--backend", "cpu")
        guarded = read_picture(picture).reshape(3, 12, 16).transpose(1, 2, 0)
        assert guarded.mean() == pytest.approx(first.mean(), rel=0.8)


def read_picture(path: Path) -> np.ndarray:
    """The R, G, B of an EXR picture, as lanes."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = file.channels()
        return np.concatenate([channels[name].pixels.ravel() for name in "RGB"])
