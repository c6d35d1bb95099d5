"""Training, scoring and the command line, on data small enough for a test."""

import csv
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from nst_train import config as configs
from nst_train import families, weights
from nst_train.__main__ import main
from nst_train.errors import UserError
from nst_train.evaluation import evaluate
from nst_train.model import Mlp
from nst_train.training import draw_points, make_model, train

TRAIN = Path(__file__).parents[1]
SMALL = """\
name = "small"
seed = 1
window = 8
hidden = [16, 16]
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
    path = tmp_path / "small.toml"
    path.write_text(SMALL)
    return configs.load(path)


def test_training_beats_the_input_on_unseen_integrands(small: configs.Config) -> None:
    """Seeds 1 to 6 reach 0.079 to 0.092 times the MSE of S_8; untrained networks, 3 or more."""
    data = families.make_data(["gaussian"], small.data.runs, small.data.terms, small.seed)
    model = make_model(small)
    untrained = evaluate(model, data)[0]
    losses = list(train(model, data.training, small))
    trained = evaluate(model, data)[0]
    assert losses[-1] < 0.8 * losses[0]
    assert (trained.data, trained.n) == ("gaussian", 8)
    assert untrained.mse_ratio > 1.0
    assert trained.mse_ratio < 0.2


def test_scores_of_known_transformations(small: configs.Config) -> None:
    """T = S scores 1 and T = a constant scores what the constant baseline scores."""
    data = families.make_data(["gaussian", "step"], runs=3, terms=20, seed=1)
    model = Mlp(8, [1])
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.zero_()
        model.layers[0].weight[0, -1] = 1.0
        model.layers[1].weight[0, 0] = 1.0  # S ≥ 0 here, so the hidden unit is linear
    scores = evaluate(model, data)
    assert [(s.data, s.n) for s in scores] == [
        (name, n) for name in ("gaussian", "step", "all") for n in (8, 16, 20)
    ]
    assert [s.mse_ratio for s in scores] == pytest.approx([1.0] * 9)

    with torch.no_grad():
        model.layers[1].weight.zero_()
        model.layers[1].bias.fill_(data.training.reference.mean())
    for score in evaluate(model, data):
        assert score.mse_ratio == pytest.approx(score.constant_mse_ratio, rel=1e-5)


def test_training_is_reproducible(small: configs.Config) -> None:
    data = families.make_data(["gaussian"], runs=4, terms=16, seed=1)
    config = replace(small, epochs=2)
    first, second = make_model(config), make_model(config)
    assert list(train(first, data.training, config)) == list(train(second, data.training, config))
    assert all(torch.equal(a, b) for a, b in zip(first.parameters(), second.parameters()))


def test_divergence_is_an_error(small: configs.Config) -> None:
    data = families.make_data(["gaussian"], runs=4, terms=16, seed=1)
    config = replace(small, loss="L0", learning_rate=1e30)
    with pytest.raises(UserError, match="diverged.*lower learning_rate"):
        list(train(make_model(config), data.training, config))


def test_points_are_drawn_evenly_and_without_repeats() -> None:
    rng = torch.Generator().manual_seed(1)
    assert draw_points(5, 0, rng).tolist() == [0, 1, 2, 3, 4]
    draws = [draw_points(10, 4, rng).tolist() for _ in range(2000)]
    assert all(len(set(points)) == 4 for points in draws)
    # Each index is expected 800 times, with standard deviation 22.
    counts = np.bincount(np.ravel(draws), minlength=10)
    assert np.abs(counts - 800).max() < 110


def test_command_exports_weights_metrics_and_config(tmp_path: Path) -> None:
    config = tmp_path / "small.toml"
    config.write_text(re.sub("epochs = .*", "epochs = 2", SMALL))
    out = tmp_path / "out"
    line = [sys.executable, "-m", "nst_train", str(config), "--out", str(out)]
    result = subprocess.run(line, cwd=TRAIN, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    assert (out / "config.toml").read_text() == config.read_text()
    _, metadata = weights.load(out / "small.safetensors")
    assert metadata["trained_on"] == "family:gaussian"
    assert metadata["samples"] == "8..32"
    assert metadata["epochs"] == "2"
    assert metadata["config"] == config.read_text()
    with (out / "metrics.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["n"] for row in rows] == ["8", "16", "32"]
    assert all(float(row["mse_ratio"]) > 0 for row in rows)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        (SMALL.replace("loss =", "los ="), "unknown key 'los'; did you mean 'loss'?"),
        (SMALL.replace("seed = 1", 'seed = "1"'), "seed = '1': expected int"),
        (None, "cannot read the config: No such file"),
    ],
)
def test_mistakes_end_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str | None, complaint: str
) -> None:
    config = tmp_path / "config.toml"
    if text is not None:
        config.write_text(text)
    assert main([str(config), "--out", str(tmp_path / "out")]) == 1
    message = capsys.readouterr().err
    assert message.startswith(f"error: {config}: ")
    assert complaint in message
    assert message.count("\n") == 1
