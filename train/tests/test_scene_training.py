"""Networks for any scene: their data, loss, training and scores."""

import csv
import math
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from nst_train import config as configs
from nst_train import evaluation, runs, scene_evaluation, scene_renders, weights
from nst_train.errors import UserError
from nst_train.model import SampleMlp
from nst_train.power_means import PowerMeans
from nst_train.scene_renders import Scene, SceneData
from nst_train.scene_training import SceneTraining, draw_family, draw_scenes, loss_of

FORM = PowerMeans([0.5, 1.0, 2.0], floor=0.01, scale_estimate=1.0, scale_unit=0.01)
TINY = """\
name = "tiny"
seed = 1
window = 2
hidden = [8, 8]
inputs = "samples"
start = "input"
loss = "L1"
epsilon = 1e-6
epochs = 3
batch_size = 400
learning_rate = 1e-2
terms_per_step = 2

[samples]
powers = [0.5, 1, 2]
floor = 1e-2
scale_estimate = 1
scale_unit = 1e-2

[data]
kind = "random-scenes"
branches = ["plane", "room"]
scenes = 2
held_out = ["maze"]
held_out_scenes = 2
families = ["gaussian", "step"]
family_share = 0.25
size = [5, 3]
runs = 2
terms = 16
reference_spp = 64
first_seed = 5
batches = 10
"""


def parse(text: str = TINY) -> configs.Config:
    return configs.parse(tomllib.loads(text), text)


def made_up_scene(branch: str, seed: int, lanes: int = 300, terms: int = 16) -> Scene:
    """Brightness of about 1 in all lanes, and samples that are mostly 0: S is noisy, a constant is not."""
    rng = np.random.default_rng(seed)
    brightness = rng.uniform(0.9, 1.1, lanes)
    samples = brightness * 10 * (rng.random((4 * terms, lanes)) < 0.1)
    sums = {n: torch.from_numpy(scene_renders.pictures(samples, n, FORM)) for n in (8, 16)}
    halves = torch.from_numpy(brightness + rng.normal(0, 0.1, (2, lanes))).float()
    deviation = torch.from_numpy(brightness * math.sqrt(9)).float()
    return Scene(f"{branch}-{seed}", branch, sums, halves, deviation)


def made_up_data() -> SceneData:
    training = [made_up_scene("plane", seed) for seed in range(4)]
    held_out = [made_up_scene(branch, 10 + i) for i, branch in enumerate(("maze", "hall", "maze", "hall"))]
    return SceneData(training, held_out, "random:plane")


def test_samples_come_back_from_running_means() -> None:
    """f32 means of 16 samples: some 1e-6 of the largest sum is lost, and what was 0 is 0."""
    rng = np.random.default_rng(1)
    samples = rng.exponential(size=(16, 200)) * (rng.random((16, 200)) < 0.5)
    samples[3, :20] = 1e4
    means = (samples.cumsum(0) / np.arange(1, 17)[:, None]).astype(np.float32)
    found = scene_renders.samples_of(means)
    assert (np.abs(found - samples) <= 1e-6 * samples.sum(0)).all()
    assert (found[samples == 0.0] == 0.0).all()
    assert (found[:, 20:][samples[:, 20:] > 1e-3] != 0.0).all()


def test_pictures_are_sums_over_folds() -> None:
    samples = np.arange(1.0, 49.0).reshape(24, 2)
    found = scene_renders.pictures(samples, 8, FORM)
    assert found.shape == (3, 4, 3, 2)
    of_fold = samples[[8 + 1, 8 + 5], 1]  # draw 1, fold 1, lane 1
    assert found[1, 1, :, 1] == pytest.approx([np.sqrt(of_fold).sum(), of_fold.sum(), (of_fold**2).sum()])
    assert scene_renders.counts(64) == [8, 16, 32, 64]


def test_scenes_are_rendered_once(tmp_path: Path, fake_nst: Path) -> None:
    config = parse()
    cache = tmp_path / "cache"
    data = scene_renders.make_data(config.data, FORM, cache)
    names = [scene.name for scene in data.training]
    assert names == ["plane-000", "room-000", "plane-001", "room-001"]
    assert [scene.name for scene in data.held_out] == ["maze-000", "maze-001"]
    assert data.trained_on == "family:gaussian,family:step,random:plane,random:room"
    calls = fake_nst.read_text().splitlines()
    assert calls[:2] == ["all 5 2 16 random 8 box", "window 1000005 2 64 random 8 box"]
    assert len(calls) == 12

    # Noise of deviation 0.1 around x + 1; row 0 has none. Means of 32 samples, and of 64.
    scene = data.training[0]
    expected = torch.arange(1.0, 6.0).repeat(9)
    sums = scene.sums[16].double()
    assert sums.shape == (2, 4, 3, 45)
    means = sums[:, :, 1].sum(dim=1) / 16
    assert (means - expected).abs().max() < 5 * 0.1 / 4
    assert (scene.reference - expected).abs().max() < 5 * 0.1 / 8
    assert not torch.equal(scene.reference[0], scene.reference[1])
    quiet = torch.zeros(3, 3, 5, dtype=torch.bool)
    quiet[:, 0] = True
    assert scene.deviation[quiet.flatten()].max() < 1e-4
    assert 0.05 < scene.deviation[~quiet.flatten()].min() < scene.deviation.max() < 0.2

    again = scene_renders.make_data(config.data, FORM, cache)
    assert len(fake_nst.read_text().splitlines()) == 12
    assert torch.equal(again.held_out[1].sums[8], data.held_out[1].sums[8])
    more = replace(config.data, scenes=3)
    assert len(scene_renders.make_data(more, FORM, cache).training) == 6
    assert len(fake_nst.read_text().splitlines()) == 16

    damaged = next(cache.glob("maze-001-*.npz"))
    damaged.write_bytes(damaged.read_bytes()[:2000])
    with pytest.raises(UserError, match=r"maze-001-.*: damaged; delete it"):
        scene_renders.make_data(config.data, FORM, cache)


def test_pictures_of_training_have_some_folds() -> None:
    config, scene = parse(), made_up_scene("plane", 1)
    rng = torch.Generator().manual_seed(1)
    pictures = draw_scenes(config, [scene], 200, rng)
    assert pictures.sums.shape == (3, 200, 300) and pictures.reference.shape == (200, 300)
    assert set(pictures.n.flatten().tolist()) == {2, 4, 6, 8, 12, 16}
    s = pictures.sums[1] / pictures.n
    torch.testing.assert_close(s.mean(dim=1, keepdim=True), pictures.unit)
    # The mean of S over lanes and pictures is that of I, about 1, whatever n is.
    assert pictures.unit.mean().item() == pytest.approx(1.0, abs=0.05)
    torch.testing.assert_close(pictures.reference[7], scene.reference.double().mean(dim=0))
    few = draw_scenes(replace(config, batch_size=7), [scene], 3, rng)
    assert few.sums.shape == (3, 3, 7) and few.reference.shape == (3, 7)


def test_families_are_pictures_too() -> None:
    config = replace(parse(), batch_size=5000)
    for seed in range(4):
        pictures = draw_family(config, torch.Generator().manual_seed(seed))
        assert pictures.sums.shape == (3, 2, 5000) and pictures.reference.shape == (2, 5000)
        n = pictures.n.flatten()
        assert 2 <= n[0] <= n[1] <= 16
        # Of unbiased samples of a deviation below 2, and 5,000 lanes.
        s = pictures.sums[1] / pictures.n
        assert (s.mean(dim=1) - pictures.reference.mean(dim=1)).abs().max() < 4 * 2 / math.sqrt(5000 * 2)


def test_the_loss_is_the_definition() -> None:
    """Two lanes by hand."""
    t, s, i = torch.tensor([1.0, 3.0]), torch.tensor([2.0, 2.0]), torch.tensor([0.35, 1.85])
    e_t, e_s = [0.65**2, 1.15**2], [1.65**2, 0.15**2]
    logs = []
    for w in ([1.0, 1.0], [2.0, 0.5], [4.0, 0.25]):
        ratio = (w[0] * e_t[0] + w[1] * e_t[1]) / (w[0] * e_s[0] + w[1] * e_s[1] + 2 * 0.01)
        logs.append(math.log(0.1 + ratio))
    assert loss_of(t, s, i, 0.01).item() == pytest.approx(sum(logs) / 3, rel=1e-5)
    assert loss_of(s, s, i, 1e-9).item() == pytest.approx(math.log(1.1), rel=1e-5)


def test_training_beats_the_input_on_held_out_scenes() -> None:
    """Samples that are mostly 0 in scenes of one brightness: seeds 1 to 3 reach 0.35 to 0.45."""
    config, data = replace(parse(), epochs=20), made_up_data()
    training = SceneTraining(config, data)

    def scores() -> list[evaluation.Score]:
        return evaluation.network_scores(config, training.model, data, [8, 16])

    assert evaluation.ratio(scores(), "all", 8) == pytest.approx(1.0, abs=1e-6)
    while training.epoch < config.epochs:
        training.run_epoch()
    after = scores()
    assert {score.data for score in after} == {
        name + suffix for name in ("maze", "hall", "all") for suffix in ("", "/relative")
    }
    for score in after:
        if score.method == "S":
            # 300 lanes, 2 draws or more, 2 scenes: samples of kurtosis 8 and references of 0.1.
            assert score.mse == pytest.approx(1.0, abs=0.15)
        else:
            assert score.mse_ratio < 0.6
    plain = training.model.folded()
    assert isinstance(plain, SampleMlp)
    ratio = evaluation.ratio(evaluation.network_scores(config, plain, data, [8]), "all", 8)
    assert ratio == pytest.approx(evaluation.ratio(after, "all", 8), rel=1e-4)


def test_a_state_continues_to_the_same_bits() -> None:
    config, data = parse(), made_up_data()
    whole, parts = SceneTraining(config, data), SceneTraining(config, data)
    whole.run_epoch()
    parts.run_epoch()
    other = SceneTraining(config, data)
    other.restore(parts.state())
    assert other.run_epoch() == whole.run_epoch()
    for a, b in zip(other.model.parameters(), whole.model.parameters(), strict=True):
        assert torch.equal(a, b)


def test_scores_know_what_the_truth_is() -> None:
    """An o that makes T a known multiple of S; references with noise do not change the mean."""
    scene = made_up_scene("maze", 3, lanes=20_000)
    model = SampleMlp(FORM, [4], (2, 16))
    model.start_from_input()
    with torch.no_grad():
        model.layers[-1].bias.fill_(-0.5)
    for relative in (False, True):
        errors = scene_evaluation.scene_errors(model, scene, 8, relative)
        # S: variance 9 I²/8. T is near S/2: a quarter of the variance, and the bias I/2.
        assert errors["S"][0] == pytest.approx(1.0, abs=0.05)
        assert errors["T"][0] == pytest.approx(0.25 + 0.25 / (9 / 8), abs=0.05)
        assert errors["T"][1] == pytest.approx(0.25 / 4 + 0.25 / (9 / 8), abs=0.05)  # four draws


def test_a_run_trains_scores_and_exports(tmp_path: Path, fake_nst: Path) -> None:
    config = parse()
    out = tmp_path / "runs" / "tiny"
    runs.run(config, out)
    model, metadata = weights.load(out / "tiny.safetensors")
    assert isinstance(model, SampleMlp) and model.form == FORM and model.trained == (2, 16)
    assert metadata["samples"] == "2..16" and metadata["sampler"] == "random"
    with (out / "metrics.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert {(row["data"], row["method"], row["n"]) for row in rows} == {
        (data, method, n) for data in ("maze", "maze/relative") for method in "ST" for n in ("8", "16")
    }
    calls = len(fake_nst.read_text().splitlines())
    other = TINY.replace('name = "tiny"', 'name = "other"').replace("[8, 8]", "[4]")
    runs.run(parse(other), tmp_path / "runs" / "other")  # renders nothing anew
    assert len(fake_nst.read_text().splitlines()) == calls


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ('["plane", "room"]', '["plain"]', "data.branches"),
        ('["plane", "room"]', '["plane", "plane"]', "data.branches"),
        ('["maze"]', '["maze", "room"]', "data.held_out"),
        ('["maze"]', "[]", "data.held_out"),
        ("terms = 16", "terms = 24", "data.terms = 24"),
        ("terms = 16", "terms = 8", "data.terms = 8"),
        ("family_share = 0.25", "family_share = 1", "data.family_share"),
        ("\nscenes = 2", "\nscenes = 0", "data.scenes"),
        ("[5, 3]", "[5]", "data.size"),
        ("batches = 10", "batches = 0", "data.batches"),
        ('["gaussian", "step"]', '["gauss"]', "data.families"),
        ('inputs = "samples"', 'inputs = "raw"', "need each other"),
    ],
)
def test_mistakes_of_configs_are_named(old: str, new: str, complaint: str) -> None:
    assert TINY.count(old) == 1
    with pytest.raises(UserError) as caught:
        parse(TINY.replace(old, new))
    assert complaint in str(caught.value)
