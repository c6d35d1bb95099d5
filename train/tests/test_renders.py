"""Sequence files, and data from a stand-in for the `nst` binary."""

import os
import sys
from pathlib import Path

import numpy as np
import pytest
from fake_nst import SCENE
from sequence_writer import write_sequence

from nst_train import renders, sequence_file
from nst_train.config import RendersData
from nst_train.errors import UserError

WIDTH, HEIGHT = 5, 3


def random_layers(terms: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(1)
    names = ["", *(f"S{k:04}." for k in range(1, terms + 1))]
    return {name: rng.random((HEIGHT, WIDTH, 3), dtype=np.float32) for name in names}


def test_reads_terms_in_order(tmp_path: Path) -> None:
    path, layers = tmp_path / "x.exr", random_layers(12)
    write_sequence(path, layers, scene=SCENE)
    file = sequence_file.read(path, (WIDTH, HEIGHT))
    assert file.scene == SCENE
    terms = file.terms(12)
    assert terms.shape == (3 * WIDTH * HEIGHT, 12)
    lane = 2 * WIDTH * HEIGHT + 1 * WIDTH + 4  # blue, row 1, column 4
    assert terms[lane, 9] == layers["S0010."][1, 4, 2]
    assert file.final()[lane] == layers[""][1, 4, 2]


def test_bad_files_are_named(tmp_path: Path) -> None:
    path, size = tmp_path / "x.exr", (WIDTH, HEIGHT)
    with pytest.raises(UserError, match="x.exr: cannot read the sequence: No such file"):
        sequence_file.read(path, size)
    path.write_bytes(b"P6 5 3 255")
    with pytest.raises(UserError, match="x.exr: not an OpenEXR file"):
        sequence_file.read(path, size)

    layers = random_layers(8)
    write_sequence(path, layers)
    with pytest.raises(UserError, match="no attribute nst.scene"):
        sequence_file.read(path, size)
    write_sequence(path, layers, scene=SCENE)
    with pytest.raises(UserError, match="5x3 pixels, expected 3x5"):
        sequence_file.read(path, (HEIGHT, WIDTH))
    with pytest.raises(UserError, match=r"no channel S0009.R \(it holds 8 terms\); .*--keep all"):
        sequence_file.read(path, size).terms(9)

    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(UserError, match="x.exr: damaged OpenEXR file"):
        sequence_file.read(path, size).terms(8)

    layers["S0003."][0, 0, 1] = np.nan
    write_sequence(path, layers, scene=SCENE)
    with pytest.raises(UserError, match="channel S0003.G holds NaN"):
        sequence_file.read(path, size).terms(8)
    halves = {name: pixels.astype(np.float16) for name, pixels in random_layers(8).items()}
    write_sequence(path, halves, scene=SCENE)
    with pytest.raises(UserError, match="float16, expected float32"):
        sequence_file.read(path, size).final()


@pytest.fixture
def fake_nst(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Makes fake_nst.py the renderer; returns the log of its calls."""
    binary, log = tmp_path / "nst", tmp_path / "calls"
    script = Path(__file__).with_name("fake_nst.py")
    binary.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{script}" "$@"\n')
    binary.chmod(0o755)
    monkeypatch.setenv("NST", str(binary))
    monkeypatch.setenv("FAKE_NST_LOG", str(log))
    return log


@pytest.fixture
def settings(tmp_path: Path) -> RendersData:
    scene = tmp_path / "scene" / "box.obj"
    scene.parent.mkdir()
    scene.write_text("v 0 0 0\n")
    return RendersData(
        kind="renders",
        scene=str(scene),  # an absolute path stays what it is
        size=[WIDTH, HEIGHT],
        runs=2,
        evaluation_runs=1,
        terms=10,
        reference_spp=500,
        first_seed=5,
    )


def test_renders_once_and_drops_constant_lanes(
    fake_nst: Path, settings: RendersData, tmp_path: Path
) -> None:
    data = renders.make_data(settings, tmp_path / "cache")
    calls = fake_nst.read_text().splitlines()
    assert sorted(calls) == ["all 5 10", "all 6 10", "all 7 10", "window 8 500"]
    assert not list(tmp_path.glob("cache/**/*.image.exr"))

    lanes = WIDTH * (HEIGHT - 1) * 3  # row 0 is constant
    (held_out,) = data.held_out.values()
    assert data.training.estimates.shape == (lanes, 2, 10)
    assert held_out.estimates.shape == (lanes, 1, 10)
    assert data.trained_on == f"scene:{SCENE}"
    # 500 samples of deviation 0.1 average to 0.0045 (1 σ)
    truth = np.tile(np.arange(1.0, WIDTH + 1), 3 * (HEIGHT - 1))
    np.testing.assert_allclose(data.training.reference.numpy(), truth, atol=0.03)

    again = renders.make_data(settings, tmp_path / "cache")
    assert again.training.estimates.equal(data.training.estimates)
    assert len(fake_nst.read_text().splitlines()) == 4

    Path(settings.scene).write_text("v 1 1 1\n")
    renders.make_data(settings, tmp_path / "cache")
    assert len(fake_nst.read_text().splitlines()) == 8, "a changed scene is rendered again"


def test_a_failing_renderer_is_quoted(
    fake_nst: Path, settings: RendersData, tmp_path: Path
) -> None:
    with pytest.raises(UserError, match="seed 13, failed .*error: the scene is on fire put it out"):
        renders.render(Path(settings.scene), (5, 3), 8, 13, "all", tmp_path / "x.exr")
    assert not (tmp_path / "x.exr").exists()


def test_missing_scene_and_renderer_are_named(
    settings: RendersData, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NST", str(tmp_path / "absent"))
    with pytest.raises(UserError, match="absent: no such renderer; build it with `cargo build"):
        renders.make_data(settings, tmp_path / "cache")
    os.remove(settings.scene)
    with pytest.raises(UserError, match="data.scene: no such file"):
        renders.make_data(settings, tmp_path / "cache")


def test_rounding_is_not_variation() -> None:
    constant = np.full((1, 2, 4), 0.1, np.float32)
    rounded = constant * np.float32(1 + 2**-23)
    assert rounded[0, 0, 0] != constant[0, 0, 0]
    estimates = np.concatenate([constant, rounded], axis=1)
    assert renders.varying(estimates).tolist() == [False]
    assert renders.varying(np.zeros((1, 2, 4), np.float32)).tolist() == [False]
    estimates[0, 1, 3] = 0.2
    assert renders.varying(estimates).tolist() == [True]
