"""Datasets, and data from a stand-in for the `nst` binary."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dataset_writer import write_dataset
from fake_nst import SCENE
from nst_train import dataset, renders
from nst_train.config import RendersData
from nst_train.errors import UserError

WIDTH, HEIGHT = 5, 3
SIZE = (WIDTH, HEIGHT)


def random_sequences(runs: int, terms: int) -> np.ndarray:
    return np.random.default_rng(1).random((runs, terms, 3 * WIDTH * HEIGHT), dtype=np.float32)


def test_reads_runs_in_order(tmp_path: Path) -> None:
    path, sequences = tmp_path / "x.safetensors", random_sequences(2, 12)
    write_dataset(path, sequences, SIZE, sampler="halton")
    found = dataset.read(path, SIZE, 2, list(range(1, 13)))
    assert (found.scene, found.sampler) == (SCENE, "halton")
    assert isinstance(found.sequences, np.memmap)
    for run in (0, 1):
        np.testing.assert_array_equal(found.run(run), sequences[run])


@pytest.mark.parametrize(
    ("changed", "shape", "complaint"),
    [
        ({"format": "nst-weights-1"}, (2, 9), "not a dataset of nst"),
        ({"width": "3"}, (2, 9), "3x3 pixels, expected 5x3"),
        ({"sample_counts": "1,2,4,5,6,7,8,9,10"}, (2, 9), "other sample counts than 1 to 9"),
        ({}, (2, 8), "other sample counts than 1 to 9"),
        ({}, (3, 9), r"F32 \[3, 9, 45\], expected F32 \[2, 9, 45\]"),
    ],
)
def test_other_datasets_are_refused(
    tmp_path: Path, changed: dict[str, str], shape: tuple[int, int], complaint: str
) -> None:
    path = tmp_path / "x.safetensors"
    write_dataset(path, random_sequences(*shape), SIZE, **changed)
    with pytest.raises(UserError, match=f"x.safetensors: .*{complaint}"):
        dataset.read(path, SIZE, 2, list(range(1, 10)))


def test_damaged_datasets_are_named(tmp_path: Path) -> None:
    path = tmp_path / "x.safetensors"

    def read() -> dataset.Dataset:
        return dataset.read(path, SIZE, 2, list(range(1, 10)))

    with pytest.raises(UserError, match="x.safetensors: cannot read the dataset: No such file"):
        read()
    for junk in (b"", b"P6 5 3 255", b"\x04" + bytes(7) + b"junk", b"\x02" + bytes(7) + b"[]"):
        path.write_bytes(junk)
        with pytest.raises(UserError, match="not a safetensors file, or a damaged one"):
            read()

    sequences = random_sequences(2, 9)
    write_dataset(path, sequences, SIZE)
    whole = path.read_bytes()
    path.write_bytes(whole[:-1])
    with pytest.raises(UserError, match="damaged: .* bytes of numbers, expected 3240"):
        read()
    for bad in (np.nan, np.inf):
        sequences[1, 3, 4] = bad
        write_dataset(path, sequences, SIZE)
        read().run(0)
        with pytest.raises(UserError, match="run 1 contains NaN or infinity"):
            read().run(1)
    write_dataset(path, random_sequences(2, 9).astype(np.float16), SIZE)
    with pytest.raises(UserError, match="F16 .* expected F32"):
        read()


def test_renders_once_and_drops_constant_lanes(fake_nst: Path, settings: RendersData, tmp_path: Path) -> None:
    data = renders.make_data(settings, tmp_path / "cache")
    calls = fake_nst.read_text().splitlines()
    assert calls == ["all 5 3 10 random 2 center", "window 8 1 500 random 2 center"]
    assert not list(tmp_path.glob("cache/**/*.part.safetensors"))

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
    assert len(fake_nst.read_text().splitlines()) == 2

    Path(settings.scene).write_text("v 1 1 1\n")
    renders.make_data(settings, tmp_path / "cache")
    assert len(fake_nst.read_text().splitlines()) == 4, "a changed scene is rendered again"


def test_one_channel_of_a_grey_scene_is_enough(
    fake_nst: Path, settings: RendersData, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    colored = renders.load(settings, tmp_path / "colored")
    assert colored.estimates.shape == (3 * WIDTH * HEIGHT, 3, 10)
    monkeypatch.setenv("FAKE_NST_GREY", "1")
    grey = renders.load(settings, tmp_path / "grey")
    assert grey.estimates.shape == (WIDTH * HEIGHT, 3, 10)
    assert grey.reference.shape == (WIDTH * HEIGHT,)


def test_what_was_asked_for_is_rendered_and_checked(
    fake_nst: Path, settings: RendersData, tmp_path: Path
) -> None:
    cache = tmp_path / "cache"
    renders.load(replace(settings, sampler="halton", max_depth=8, pixel="box"), cache)
    assert "all 5 3 10 halton 8 box" in fake_nst.read_text()
    renders.load(settings, cache)
    (runs,) = cache.glob("*/*-random-depth2-center-10spp-3runs-seed5.safetensors")

    write_dataset(runs, random_sequences(3, 10), SIZE, sampler="halton")
    with pytest.raises(UserError, match="made with the sampler 'halton', not 'random'"):
        renders.load(settings, cache)
    write_dataset(runs, random_sequences(3, 10), SIZE, scene="box:1")
    with pytest.raises(UserError, match="rendered from box:1, but .* from box:v2:0123456789abcdef"):
        renders.load(settings, cache)


def test_a_failing_renderer_is_quoted(fake_nst: Path, settings: RendersData, tmp_path: Path) -> None:
    with pytest.raises(UserError, match="failed .1.: error: the scene is on fire put it out"):
        renders.load(replace(settings, first_seed=13), tmp_path / "cache")
    assert not list(tmp_path.glob("cache/**/*.safetensors"))


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
