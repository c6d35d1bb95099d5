"""A run's folder and the command line: what is left behind, resumed, and refused."""

import csv
import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import torch

from nst_train import config as configs
from nst_train import results, runs, weights
from nst_train.__main__ import choose_device, main
from nst_train.errors import UserError
from nst_train.evaluation import Score
from nst_train.training import Training
from test_training import SMALL

TRAIN = Path(__file__).parents[1]
TINY = SMALL.replace("epochs = 150", "epochs = 6").replace("runs = 50", "runs = 8")


@pytest.fixture
def tiny(tmp_path: Path) -> Path:
    path = tmp_path / "tiny.toml"
    path.write_text(TINY + "\n[small]\nhidden = [4]\n")
    return path


def test_command_leaves_all_that_it_promises(tiny: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    line = [sys.executable, "-m", "nst_train", str(tiny), "--out", str(out), "--small"]
    line += ["--device", "cpu"]
    result = subprocess.run(line, cwd=TRAIN, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    assert "epoch 6/6" in result.stdout and "\r" not in result.stdout + result.stderr
    assert (out / "config.toml").read_text() == tiny.read_text()
    assert (out / "setting").read_text() == "small\n"
    versions = json.loads((out / "versions.json").read_text())
    assert versions["torch"] == torch.__version__ and versions["nst"] is None
    assert list(out.glob("tensorboard/events.*"))
    assert not list(out.glob("*.part"))

    model, metadata = weights.load(out / "tiny.safetensors")
    assert model.layers[0].out_features == 4
    assert metadata["trained_on"] == "family:gaussian"
    assert (metadata["samples"], metadata["epochs"]) == ("8..32", "6")
    assert metadata["config"].startswith(tiny.read_text())
    assert metadata["config"].endswith("# The small setting was used.\n")
    assert "sampler" not in metadata
    with (out / "metrics.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [int(row["n"]) for row in rows if row["method"] == "T"] == list(range(8, 33))
    assert list(rows[0]) == ["name", "data", "method", "n", "mse", "bias2", "variance", "mse_ratio"]
    with (out / "history.csv").open() as file:
        history = list(csv.DictReader(file))
    assert [row["epoch"] for row in history] == ["1", "2", "3", "4", "5", "6"]
    seconds = [float(row["seconds"]) for row in history]
    assert seconds == sorted(seconds) and seconds[0] > 0


def test_an_interrupted_run_ends_with_the_same_weights(
    tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = configs.load(tiny)
    runs.run(config, tmp_path / "whole")
    monkeypatch.setattr(runs, "CHECKPOINT_SECONDS", 0.0)
    run_epoch = Training.run_epoch

    def interrupt(training: Training) -> float:
        if training.epoch == 4:
            raise KeyboardInterrupt
        return run_epoch(training)

    monkeypatch.setattr(Training, "run_epoch", interrupt)
    with pytest.raises(KeyboardInterrupt):
        runs.run(config, tmp_path / "parts")
    assert len((tmp_path / "parts" / "history.csv").read_text().splitlines()) == 1 + 4
    monkeypatch.setattr(Training, "run_epoch", run_epoch)
    runs.run(config, tmp_path / "parts")

    def stored(folder: str, name: str) -> bytes:
        return (tmp_path / folder / name).read_bytes()

    assert stored("parts", "tiny.safetensors") == stored("whole", "tiny.safetensors")
    assert stored("parts", "metrics.csv") == stored("whole", "metrics.csv")
    losses = [
        [row.split(",")[1] for row in stored(folder, "history.csv").decode().splitlines()]
        for folder in ("parts", "whole")
    ]
    assert losses[0] == losses[1]

    # A run that does not restore the random numbers is told apart.
    state = torch.load(tmp_path / "parts" / "checkpoint.pt", weights_only=True)
    training = Training(config, runs.load_data(config, tmp_path).training)
    fresh = training.rng.get_state()
    training.restore(state)
    assert not torch.equal(training.rng.get_state(), fresh)


def test_a_folder_of_another_run_is_refused(tiny: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    runs.run(configs.load(tiny), out)
    before = (out / "tiny.safetensors").read_bytes()
    with pytest.raises(UserError, match="setting: .* contains a run of another config or setting"):
        runs.run(configs.load(tiny, "small"), out)
    tiny.write_text(tiny.read_text().replace("seed = 1", "seed = 2"))
    with pytest.raises(UserError, match="config.toml: .* contains a run of another config"):
        runs.run(configs.load(tiny), out)
    assert (out / "tiny.safetensors").read_bytes() == before


def test_damaged_checkpoints_are_refused(tiny: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    config = configs.load(tiny)
    runs.run(config, out)
    checkpoint = out / "checkpoint.pt"
    whole = checkpoint.read_bytes()
    state = torch.load(checkpoint, weights_only=True)
    for junk in (b"", b"junk", whole[: len(whole) // 2]):
        checkpoint.write_bytes(junk)
        with pytest.raises(UserError, match="checkpoint.pt: not a checkpoint, or a damaged one"):
            runs.run(config, out)
    for change in ({"format": "x"}, {"model": {}}, {"optimizer": {}}, {"rng": None}):
        torch.save(state | change, checkpoint)
        with pytest.raises(UserError, match="checkpoint.pt: not a checkpoint, or a damaged one"):
            runs.run(config, out)
    torch.save(state | {"trained_on": "scene:box:1"}, checkpoint)
    with pytest.raises(UserError, match="trained on scene:box:1, but the data are now family"):
        runs.run(config, out)


def test_several_configs_go_into_folders_of_their_names(tiny: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.toml"
    other.write_text(tiny.read_text().replace('"tiny"', '"other"'))
    out = tmp_path / "runs"
    assert main([str(tiny), str(other), "--out", str(out), "--small", "--device", "cpu"]) == 0
    assert (out / "tiny" / "tiny.safetensors").is_file()
    assert (out / "other" / "other.safetensors").is_file()
    shutil.copyfile(tiny, other)
    assert main([str(tiny), str(other), "--out", str(out), "--small"]) == 1


def test_weights_are_rounded_only_where_that_costs_little() -> None:
    def scores(*ratios: float) -> list[Score]:
        return [Score("x", "y", "T", 8 + i, 1, 0, 1, r) for i, r in enumerate(ratios)]

    assert results.loses_little(scores(0.2, 0.5), scores(0.207, 0.504))
    assert not results.loses_little(scores(0.2, 0.5), scores(0.207, 0.506))
    assert results.loses_little(scores(0.2), scores(0.1))


def test_cuda_without_cuda_is_an_error(
    tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert main([str(tiny), "--out", str(tmp_path / "out"), "--device", "cuda"]) == 1
    assert "--device cuda: PyTorch finds no CUDA device" in capsys.readouterr().err
    assert choose_device("auto") == "cpu"
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    assert (choose_device("auto"), choose_device("cpu")) == ("cuda", "cpu")


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
