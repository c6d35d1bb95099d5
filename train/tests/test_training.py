"""Training and scoring, on data small enough for a test."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from nst_train import config as configs
from nst_train import evaluation, families
from nst_train.errors import UserError
from nst_train.model import Mlp
from nst_train.sequences import whitening, windows
from nst_train.training import Training, draw_points

SMALL = """\
name = "tiny"
seed = 1
window = 8
hidden = [16, 16]
inputs = "raw"
start = "random"
loss = "L2"
epsilon = 1e-4
epochs = 150
batch_size = 12
learning_rate = 1e-2
terms_per_step = 4

[data]
kind = "families"
families = ["gaussian"]
runs = 50
terms = 32
"""


@pytest.fixture
def small(tmp_path: Path) -> configs.Config:
    path = tmp_path / "tiny.toml"
    path.write_text(SMALL)
    return configs.load(path)


def train(config: configs.Config, data: families.Data) -> Training:
    training = Training(config, data.training)
    while training.epoch < config.epochs:
        training.run_epoch()
    return training


def test_training_beats_the_input_on_unseen_integrands(small: configs.Config) -> None:
    """Seeds 1 to 6 reach 0.10 to 0.14 times the MSE of S_8; untrained networks, 3 or more. The ratio is
    of 9 × 50 sequences, so chance moves it by some 10 %."""
    data = families.make_data(["gaussian"], small.data.runs, small.data.terms, small.seed)

    def ratio(model: Mlp) -> float:
        scores = evaluation.network_scores(small, model, data, [8])
        return evaluation.ratio(scores, "gaussian", 8)

    assert ratio(Training(small, data.training).model) > 1.0
    training = train(small, data)
    assert training.losses[-1] < 0.8 * training.losses[0]
    assert ratio(training.model) < 0.25


def test_whitened_inputs_train_faster_and_fold_into_plain_weights(small: configs.Config) -> None:
    """Seeds 1 to 3 reach 0.16 to 0.17 times the MSE of S_16 in 60 epochs, with raw inputs 0.26 to 0.28."""
    data = families.make_data(["gaussian-step"], small.data.runs, small.data.terms, small.seed)

    def ratio(inputs: str, start: str, epochs: int) -> float:
        config = replace(small, inputs=inputs, start=start, epochs=epochs)
        training = train(config, data)
        plain = training.model.folded()
        assert [name for name, _ in plain.named_buffers()] == []
        held_out = data.held_out["gaussian-step"]
        both = [evaluation.transformed(model, held_out, 16) for model in (training.model, plain)]
        # f32 at values of about 1, times folded weights of up to some hundreds.
        torch.testing.assert_close(*both, rtol=0.0, atol=1e-4)
        scores = evaluation.network_scores(config, plain, data, [16])
        return evaluation.ratio(scores, "gaussian-step", 16)

    assert ratio("whitened", "input", 0) == pytest.approx(1.0, abs=1e-4)
    assert ratio("whitened", "random", 60) < 0.8 * ratio("raw", "random", 60)


def test_whitening_makes_windows_uncorrelated() -> None:
    data = families.make_data(["gaussian"], runs=5, terms=20, seed=1).training
    center, basis = whitening(data.estimates, 8)
    x = (windows(data.estimates, 8).reshape(-1, 8).double() - center) @ basis.T
    torch.testing.assert_close(x.mean(dim=0), torch.zeros(8).double(), rtol=0.0, atol=1e-9)
    torch.testing.assert_close(torch.cov(x.T, correction=0), torch.eye(8).double(), rtol=0.0, atol=1e-6)

    # Windows without any variation but a common one: the other axes are magnified no further.
    center, basis = whitening(torch.arange(4.0).reshape(4, 1, 1).expand(4, 1, 9), 8)
    deviation = (8 * 1.25) ** 0.5  # of 0 … 3, times √8
    assert torch.linalg.matrix_norm(basis, 2).item() == pytest.approx(1e3 / deviation)


def test_scores_of_known_transformations(small: configs.Config) -> None:
    """T = S scores 1 and T = a constant scores what the constant baseline scores."""
    config = replace(small, data=replace(small.data, families=["gaussian", "step"], runs=3, terms=12))
    data = families.make_data(["gaussian", "step"], runs=3, terms=12, seed=1)
    model = Mlp(8, [1])
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.zero_()
        model.layers[0].weight[0, -1] = 1.0
        model.layers[1].weight[0, 0] = 1.0  # S ≥ 0 here, so the hidden unit is linear
    scores = evaluation.evaluate(config, model, data)
    keys = [(s.data, s.n) for s in scores if s.method == "T"]
    assert keys == [(name, n) for name in ("gaussian", "step", "all") for n in range(8, 13)]
    assert {s.method for s in scores} == {"S", "T", "constant", "bayes", "aitken", "levin-u", "an-gn"}
    for s in scores:
        assert s.mse == pytest.approx(s.bias2 + s.variance)
        assert s.method != "T" or s.mse_ratio == pytest.approx(1.0)

    with torch.no_grad():
        model.layers[1].weight.zero_()
        model.layers[1].bias.fill_(data.training.reference.mean())
    scores = evaluation.evaluate(config, model, data)
    for name in ("gaussian", "step", "all"):
        for n in range(8, 13):
            t = evaluation.ratio(scores, name, n)
            assert t == pytest.approx(evaluation.ratio(scores, name, n, "constant"), rel=1e-5)


def test_bias_and_variance_are_told_apart() -> None:
    """Two runs at I + 1 and I + 3: bias 2, variance 1; the next integrand is right."""
    error = evaluation.errors(np.array([[6.0, 8.0], [1.0, 1.0]]), np.array([5.0, 1.0]))
    assert error == pytest.approx((5.0 / 2, 4.0 / 2, 1.0 / 2))


def test_training_is_reproducible(small: configs.Config) -> None:
    data = families.make_data(["gaussian"], runs=4, terms=16, seed=1)
    config = replace(small, epochs=2)
    first, second = train(config, data), train(config, data)
    assert first.losses == second.losses
    pairs = zip(first.model.parameters(), second.model.parameters(), strict=True)
    assert all(torch.equal(a, b) for a, b in pairs)
    other = train(replace(config, seed=2), data)
    assert other.losses != first.losses


def test_the_learning_rate_falls_along_half_a_cosine(small: configs.Config) -> None:
    data = families.make_data(["gaussian"], runs=2, terms=16, seed=1)
    training = Training(replace(small, epochs=4), data.training)
    rates = [training.learning_rate()]
    for _ in range(4):
        training.run_epoch()
        rates.append(training.learning_rate())
    expected = [0.5e-2 * (1.0 + math.cos(math.pi * epoch / 4)) for epoch in range(5)]
    assert rates == pytest.approx(expected)


def test_mixed_precision_is_for_hidden_layers_alone() -> None:
    """Rounded to bf16, estimates whose differences matter would be equal."""
    model = Mlp(2, [4, 4])
    inputs: dict[int, torch.dtype] = {}
    outputs: dict[int, torch.dtype] = {}
    for index, layer in enumerate(model.layers):

        def note(layer, given, result, index=index) -> None:
            inputs[index], outputs[index] = given[0].dtype, result.dtype

        layer.register_forward_hook(note)
    exact = model(torch.tensor([[1.0, 1.001]]))
    assert set(outputs.values()) == {torch.float32}
    model.mixed = True
    mixed = model(torch.tensor([[1.0, 1.001]]))
    assert list(outputs.values()) == [torch.float32, torch.bfloat16, torch.float32]
    assert inputs[0] == inputs[2] == torch.float32
    torch.testing.assert_close(mixed, exact, rtol=0.05, atol=0.01)
    mixed.sum().backward()
    assert all(p.grad.dtype == torch.float32 for p in model.parameters())


def test_divergence_is_an_error(small: configs.Config) -> None:
    data = families.make_data(["gaussian"], runs=4, terms=16, seed=1)
    with pytest.raises(UserError, match="diverged.*lower learning_rate"):
        train(replace(small, loss="L0", learning_rate=1e30), data)


def test_points_are_drawn_evenly_and_without_repeats() -> None:
    rng = torch.Generator().manual_seed(1)
    assert draw_points(5, 0, rng).tolist() == [0, 1, 2, 3, 4]
    draws = [draw_points(10, 4, rng).tolist() for _ in range(2000)]
    assert all(len(set(points)) == 4 for points in draws)
    # Each index is expected 800 times, with standard deviation 22.
    counts = np.bincount(np.ravel(draws), minlength=10)
    assert np.abs(counts - 800).max() < 110
