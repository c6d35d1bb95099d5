"""Networks that see the samples: their inputs, the integrands that they are trained on, training, files."""

import math
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from nst_train import config as configs
from nst_train import evaluation, families, fresh, runs, sample_fixtures, weights
from nst_train.errors import UserError
from nst_train.families import FAMILIES
from nst_train.model import SampleMlp
from nst_train.power_means import PowerMeans
from nst_train.sample_training import SampleTraining, draw_counts
from nst_train.sequences import Sequences
from test_weights import PROVENANCE

FORM = PowerMeans([0.125, 0.25, 0.5, 1.0, 2.0, 4.0], floor=0.01, scale_estimate=0.5, scale_unit=2.0)
TINY = """\
name = "tiny"
seed = 1
window = 4
hidden = [16, 16]
inputs = "samples"
start = "input"
loss = "L1"
epsilon = 1e-6
epochs = 4
batch_size = 128
learning_rate = 1e-2
terms_per_step = 3

[samples]
powers = [0.5, 1, 2]
floor = 1e-3
scale_estimate = 0
scale_unit = 1

[data]
kind = "fresh-families"
families = ["gaussian"]
runs = 20
terms = 16
batches = 5
"""


def parse(text: str) -> configs.Config:
    return configs.parse(tomllib.loads(text), text)


def random_lanes(lanes: int, n: int, seed: int = 1) -> torch.Tensor:
    rng = torch.Generator().manual_seed(seed)
    return torch.randn(lanes, n, generator=rng, dtype=torch.float64).exp()


def transform(model: SampleMlp, samples: torch.Tensor, unit: torch.Tensor | None = None) -> torch.Tensor:
    """T of `[lane, n]`, a batch of its own."""
    sums, n = model.form.features(samples).sum(dim=-1), torch.tensor(float(samples.shape[-1]))
    unit = model.form.estimate(sums, n).abs().mean() if unit is None else unit
    return model.double().transform(sums, n, unit).detach()


def test_inputs_are_those_of_the_definition() -> None:
    """Samples 1, −4, 0 and u = 2, by hand."""
    form = PowerMeans([0.25, 0.5, 1.0, 2.0], floor=0.1, scale_estimate=0.5, scale_unit=3.0)
    sums = form.features(torch.tensor([1.0, -16.0, 0.0], dtype=torch.float64)).sum(dim=-1)
    assert sums.tolist() == [3.0, -3.0, -15.0, 257.0]
    logs = [math.log(m / 2.0 + 0.1) for m in (1.0, 1.0, 5.0, math.sqrt(257 / 3))]
    expected = [logs[2], logs[1] - logs[0], logs[2] - logs[1], logs[3] - logs[2], math.log(3), 1 / 3]
    n, unit = torch.tensor(3.0), torch.tensor(2.0)
    assert form.inputs(sums, n, unit, (1, 64)).tolist() == pytest.approx(expected, rel=1e-12)
    assert len(expected) == form.width
    # Of other n than it was trained on, a network sees the nearest; the means are those of all n.
    for trained, k in (((4, 64), 4), ((1, 2), 2)):
        other = [*expected[:4], math.log(k), 1 / k]
        assert form.inputs(sums, n, unit, trained).tolist() == pytest.approx(other, rel=1e-12)

    model = SampleMlp(form, [4], (1, 64))
    model.start_from_input()
    assert model.transform(sums, n, unit) == -5.0
    with torch.no_grad():
        model.layers[-1].bias.fill_(0.25)
    assert model.transform(sums, n, unit).item() == -5.0 + 0.25 * (0.5 * 5.0 + 3.0 * 2.0)


def test_powers_are_powers() -> None:
    samples = random_lanes(5, 7) * torch.tensor([1, -1, 0, 1, -1, 1, 1])
    found = dict(zip(FORM.powers, FORM.features(samples), strict=True))
    assert torch.equal(found[1.0], samples)
    torch.testing.assert_close(found[0.5], samples.sign() * samples.abs() ** 0.5, rtol=1e-14, atol=0.0)
    for p in (0.125, 0.25, 2.0, 4.0):
        torch.testing.assert_close(found[p], samples.abs() ** p, rtol=1e-14, atol=0.0)


def test_the_transformation_has_no_unit_and_no_order() -> None:
    """Rounding in f64 alone: 1e-12 is some thousand times as much."""
    model = sample_fixtures.random_network(FORM, [9, 5], (4, 64), seed=3)
    samples = random_lanes(20, 12)
    t = transform(model, samples)
    for factor in (0.25, 4.0, 1e6):
        torch.testing.assert_close(transform(model, factor * samples), factor * t, rtol=1e-12, atol=0.0)
    shuffled = samples[:, torch.randperm(12, generator=torch.Generator().manual_seed(1))]
    torch.testing.assert_close(transform(model, shuffled), t, rtol=1e-12, atol=0.0)
    # With another batch's unit it is another transformation.
    other = transform(model, 4.0 * samples, unit=samples.mean())
    assert ((other - 4.0 * t).abs() > 1e-3 * t).any()


@pytest.mark.parametrize("family", FAMILIES)
def test_fresh_integrands_have_their_integrals(family: str) -> None:
    """Means of 20,000 samples, in standard errors: normal, so that none of 100 is beyond 4.5."""
    terms = 20_000
    lanes = fresh.draw(family, 100, terms, torch.Generator().manual_seed(1))
    error = lanes.samples.std(dim=1) / math.sqrt(terms)
    z = (lanes.samples.mean(dim=1) - lanes.reference) / error
    assert z.abs().max() < 4.5
    assert 0.7 < z.std() < 1.3
    assert lanes.reference.unique().numel() == 100
    known = families.references(families.integrands(family, np.linspace(0.0, 1.0, 30)))
    assert known.min() - 1e-6 <= lanes.reference.min() and lanes.reference.max() <= known.max() + 1e-6
    # Over a family's square the mean and the spread are those of a fine grid, within chance.
    many = fresh.draw(family, 20_000, 1, torch.Generator().manual_seed(2)).reference
    middle = families.references(families.integrands(family, (np.arange(40) + 0.5) / 40))
    assert many.mean().item() == pytest.approx(
        middle.mean().item(), abs=4 * middle.std().item() / math.sqrt(20_000)
    )
    assert many.std().item() == pytest.approx(middle.std().item(), rel=0.03)


def test_batches_never_repeat_and_are_of_one_family_or_all() -> None:
    names = ["gaussian", "step"]
    config = parse(TINY)
    config = replace(config, data=replace(config.data, families=names))
    training = SampleTraining(config, fresh.make_data(names, 2, 16, 1))
    kinds = set()
    seen = []
    for _ in range(30):
        lanes, family = training.draw()
        assert len(lanes) == len(family) == 128
        kinds.add(tuple(family.unique().tolist()))
        seen.append(lanes.reference)
    assert kinds == {(0,), (1,), (0, 1)}
    assert torch.cat(seen).unique().numel() > 0.99 * 30 * 128  # f32 may meet by chance


def test_counts_are_even_in_their_logarithm() -> None:
    rng = torch.Generator().manual_seed(1)
    draws = torch.stack([draw_counts(4, 64, 4, rng) for _ in range(1000)])
    assert (draws.min(), draws.max()) == (4, 64)
    assert (draws[:, :-1] <= draws[:, 1:]).all()
    # Bounds of quarters of [log 4, log 65): 8.03, 16.1, 32.4.
    assert (draws[:, 0] <= 8).all() and (draws[:, 1] >= 8).all() and (draws[:, 1] <= 16).all()
    assert (draws[:, 3] >= 32).all()


def test_training_beats_the_input_on_unseen_integrands() -> None:
    """Seeds 1 to 3 reach .10 to .12 times the MSE of S_8; at the start T is S."""
    config = replace(parse(TINY), epochs=60)
    data = fresh.make_data(["gaussian"], 50, 16, 1)
    training = SampleTraining(config, data)

    def ratio() -> float:
        scores = evaluation.network_scores(config, training.model, data, [8])
        return evaluation.ratio(scores, "gaussian", 8)

    assert ratio() == pytest.approx(1.0, abs=1e-6)
    while training.epoch < config.epochs:
        training.run_epoch()
    assert ratio() < 0.2
    plain = training.model.folded()
    assert isinstance(plain, SampleMlp)
    assert [name for name, _ in plain.named_buffers()] == []
    held_out = data.held_out["gaussian"]
    both = [evaluation.transformed(model, held_out, 8) for model in (training.model, plain)]
    # f32 at values of about 1, times folded weights of up to some hundreds.
    torch.testing.assert_close(*both, rtol=0.0, atol=1e-4)

    # A batch of scaled lanes is as good as itself.
    assert held_out.samples is not None
    scaled = Sequences(4 * held_out.estimates, 4 * held_out.reference, 4 * held_out.samples)
    t = evaluation.transformed(plain, scaled, 8)
    torch.testing.assert_close(t, 4 * both[1], rtol=1e-5, atol=0.0)


def test_round_trip(tmp_path: Path) -> None:
    model = sample_fixtures.random_network(FORM, [5, 3], (8, 64), seed=1)
    path = tmp_path / "x.safetensors"
    weights.save(path, model, PROVENANCE)
    loaded, metadata = weights.load(path)
    assert isinstance(loaded, SampleMlp)
    assert (loaded.form, loaded.trained) == (FORM, (8, 64))
    of_inputs = {
        "inputs": "samples",
        "powers": "0.125,0.25,0.5,1,2,4",
        "floor": "0.01",
        "scale_estimate": "0.5",
        "scale_unit": "2.0",
    }
    assert of_inputs.items() <= metadata.items() and "window" not in metadata
    samples = random_lanes(10, 8)
    assert torch.equal(transform(loaded, samples), transform(model, samples))

    tensors, _ = weights.load_tensors(path)
    damages = [
        ("powers", "0.5,1"),
        ("powers", "x"),
        ("powers", "0.125,2,0.5,1,4,8"),
        ("powers", "0.125,0.25,0.5,1,2,3"),
        ("floor", "nan"),
    ]
    for key, value in [*damages, ("scale_unit", "-1"), ("samples", "64..8"), ("samples", "8")]:
        weights.save_tensors(path, tensors, metadata | {key: value})
        with pytest.raises(UserError, match="do not fit"):
            weights.load(path)


def test_an_interrupted_run_ends_with_the_same_weights(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = parse(TINY)
    runs.run(config, tmp_path / "whole")
    monkeypatch.setattr(runs, "CHECKPOINT_SECONDS", 0.0)
    run_epoch = SampleTraining.run_epoch

    def interrupt(training: SampleTraining) -> float:
        if training.epoch == 2:
            raise KeyboardInterrupt
        return run_epoch(training)

    monkeypatch.setattr(SampleTraining, "run_epoch", interrupt)
    with pytest.raises(KeyboardInterrupt):
        runs.run(config, tmp_path / "parts")
    monkeypatch.setattr(SampleTraining, "run_epoch", run_epoch)
    runs.run(config, tmp_path / "parts")
    for name in ("tiny.safetensors", "metrics.csv"):
        assert (tmp_path / "parts" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    _, metadata = weights.load(tmp_path / "whole" / "tiny.safetensors")
    assert (metadata["samples"], metadata["trained_on"]) == ("4..16", "family:gaussian")


@pytest.mark.parametrize(
    ("old", "new", "complaint"),
    [
        ("powers = [0.5, 1, 2]", "powers = [0.5, 2]", "samples.powers = [0.5, 2]: must be powers"),
        ("powers = [0.5, 1, 2]", "powers = [2, 1]", "samples.powers"),
        ("powers = [0.5, 1, 2]", "powers = [0, 1]", "samples.powers"),
        ("floor = 1e-3", "floor = 0", "samples.floor"),
        ("scale_unit = 1", "scale_unit = 0", "samples.scale_unit"),
        ("scale_unit = 1", "scale = 1", "unknown key 'samples.scale'"),
        ('loss = "L1"', 'loss = "L2"', "loss = 'L2'"),
        ("terms_per_step = 3", "terms_per_step = 0", "terms_per_step = 0"),
        ("batches = 5", "batches = 0", "data.batches = 0"),
        ("batches = 5", "", "missing key 'data.batches'"),
        ('inputs = "samples"', 'inputs = "raw"', "need each other"),
        ('"fresh-families"', '"families"', "unknown key 'data.batches'"),
    ],
)
def test_mistakes_of_configs_are_named(old: str, new: str, complaint: str) -> None:
    assert TINY.count(old) == 1
    with pytest.raises(UserError) as caught:
        parse(TINY.replace(old, new))
    assert complaint in str(caught.value)


def test_fixtures_agree_with_pytorch_and_a_change_is_noticed(tmp_path: Path) -> None:
    sample_fixtures.write(tmp_path)
    sample_fixtures.check(tmp_path)
    path = tmp_path / "samples-pixels.io.safetensors"
    stored, _ = weights.load_tensors(path)
    size = stored["samples"].double().mean(dim=0).abs() + stored["unit"]
    for key in ("sums", "inputs", "output", "output_f64", "part_output_f64"):
        tensors = {name: tensor.clone() for name, tensor in stored.items()}
        wrong = 3 * sample_fixtures.TOLERANCE * (size[7] if "output" in key else tensors[key][1, 7])
        tensors[key][..., 7] += wrong
        weights.save_tensors(path, tensors, {})
        with pytest.raises(UserError, match=f"samples-pixels.io.safetensors: {key} is"):
            sample_fixtures.check(tmp_path)


def test_fixtures_leave_a_fold_out() -> None:
    """What the left-out fold contains changes nothing."""
    form, hidden, trained, n = sample_fixtures.NETWORKS["samples-pixels"]
    model = sample_fixtures.random_network(form, hidden, trained, seed=1)
    samples = sample_fixtures.random_samples(n, seed=1)
    found = sample_fixtures.outputs(model, samples)
    samples[sample_fixtures.LEFT_OUT :: 4] *= 3.0
    other = sample_fixtures.outputs(model, samples)
    assert torch.equal(other["part_output_f64"], found["part_output_f64"])
    assert not torch.equal(other["output_f64"], found["output_f64"])
