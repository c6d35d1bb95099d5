"""OpenImageIO, OpenEXR and its tools read every kind of file that nst writes: names, types, each bit."""

import json
import subprocess
from pathlib import Path

import numpy as np
import pytest

from conftest import REPOSITORY, Nst
from readers import (
    OIIOTOOL,
    Channels,
    read_dataset,
    read_oiio,
    read_openexr,
    read_openexr_tools,
    same_bits,
    write_openexr,
)

SCENE = REPOSITORY / "scenes/cornell/cornell.obj"
WIDTH, HEIGHT, SPP = 13, 37, 11
RENDER = ("render", "--scene", SCENE, "--size", f"{WIDTH}x{HEIGHT}", "--spp", SPP, "--quiet")
# Sequences without features.
LANE = ("--experts", "lane")


def read_by_all(path: Path) -> tuple[Channels, dict[str, object]]:
    """Reads a file with all programs, which must agree in every bit."""
    channels, header = read_openexr(path)
    theirs, spec = read_oiio(path)
    assert sorted(theirs) == sorted(channels)
    for name, pixels in channels.items():
        assert same_bits(pixels, theirs[name]), name
    for name, value in header.items():
        if name.startswith("nst."):
            assert spec.getattribute(name) == value, name
    listed, copied = read_openexr_tools(path)
    assert sorted(copied) == sorted(channels)
    for name, pixels in channels.items():
        assert same_bits(pixels, copied[name]), name
        type_name = {"f": "32-bit floating-point", "u": "32-bit unsigned integer"}[pixels.dtype.kind]
        assert f"    {name}, {type_name}, sampling 1 1\n" in listed, name
    for name, value in header.items():
        if name.startswith("nst."):
            shown = f'string): "{value}"' if isinstance(value, str) else "float): "
            assert f"{name} (type {shown}" in listed, name
    assert str(header["software"]).startswith("nst ")
    assert (spec.x, spec.y, spec.width, spec.height) == (0, 0, WIDTH, HEIGHT)
    return channels, header


def lanes(channels: Channels, layer: str = "", names: str = "RGB") -> np.ndarray:
    prefix = f"{layer}." if layer else ""
    return np.concatenate([channels[prefix + name].ravel() for name in names])


def f32_channels(channels: Channels) -> Channels:
    """All but the words that a rendering is continued from."""
    return {name: c for name, c in channels.items() if not name.startswith("state.")}


def test_the_comparison_sees_a_single_bit(tmp_path: Path) -> None:
    pixels = np.ones((2, 2), np.float32)
    write_openexr(tmp_path / "a.exr", {"Y": pixels})
    other = pixels.copy()
    other.view(np.uint32)[1, 1] ^= 1
    assert same_bits(read_openexr(tmp_path / "a.exr")[0]["Y"], pixels)
    assert not same_bits(read_openexr(tmp_path / "a.exr")[0]["Y"], other)


def test_pictures(nst: Nst, tmp_path: Path) -> None:
    nst(*RENDER, "--transform", "none", "-o", "x.exr")
    nst(*RENDER, "--runs", 1, "-o", "x.safetensors")
    channels, _ = read_by_all(tmp_path / "x.exr")
    layers = ("", "S.", "Variance.")
    assert sorted(channels) == sorted(layer + color for layer in layers for color in "RGB")
    assert all(pixels.dtype == np.float32 for pixels in channels.values())
    # A dataset is the raw numbers, without EXR.
    runs, _ = read_dataset(tmp_path / "x.safetensors")
    assert same_bits(lanes(channels, "S"), runs[0, -1])
    assert same_bits(lanes(channels), runs[0, -1])


def test_what_the_guard_says(nst: Nst, tmp_path: Path) -> None:
    said = json.loads(nst(*RENDER[:-1], "--json", "-o", "x.exr"))
    channels, header = read_by_all(tmp_path / "x.exr")
    assert np.count_nonzero(lanes(channels, "StdError")) > 0
    experts = ", ".join(f"{it['name']} {it['weight']:.4f}" for it in said["experts"])
    assert header["nst.expert"] == experts != ""
    for name in ("Ratio", "Low", "High"):
        assert header[f"nst.predicted{name}"] == np.float32(said[f"predicted_{name.lower()}"])


@pytest.mark.parametrize("keep", ["window", "pow2", "all"])
def test_sequences(nst: Nst, tmp_path: Path, keep: str) -> None:
    nst(*RENDER, *LANE, "--keep", keep, "--seed", 3, "--sequence", "seq.exr", "-o", "x.exr")
    nst(*RENDER, "--seed", 3, "--runs", 1, "-o", "x.safetensors")
    channels, header = read_by_all(tmp_path / "seq.exr")
    terms = [int(count) for count in str(header["nst.terms"]).split(",")]
    window = list(range(SPP - 7, SPP + 1))
    assert terms == {"window": window, "pow2": [1, 2, *window], "all": list(range(1, SPP + 1))}[keep]
    assert header["samplesPerPixel"] == SPP
    assert (header["nst.seed"], header["nst.sampler"], header["nst.folds"]) == ("3", "random", "4")
    assert str(header["nst.scene"]).startswith("cornell:")
    runs, metadata = read_dataset(tmp_path / "x.safetensors")
    assert metadata["scene"] == header["nst.scene"]
    for count in terms:
        assert same_bits(lanes(channels, f"S{count:04}"), runs[0, count - 1]), count
    assert same_bits(lanes(channels), runs[0, -1])
    folds = [f"{kind}{i}." for kind in ("fold", "root", "square") for i in range(4)]
    expected = ["", *(f"S{count:04}." for count in terms), *folds, "Variance."]
    stored = f32_channels(channels)
    assert sorted(stored) == sorted(layer + color for layer in expected for color in "RGB")
    assert all(pixels.dtype == np.float32 for pixels in stored.values())


def test_packed_mono_sequences(nst: Nst, tmp_path: Path) -> None:
    random = np.random.default_rng(1)
    samples = random.exponential(size=(6, HEIGHT, WIDTH)).astype(np.float32)
    for i, pixels in enumerate(samples):
        write_openexr(tmp_path / f"{i}.exr", {"Y": pixels}, samplesPerPixel=4)
    files = [f"{i}.exr" for i in range(6)]
    nst("pack", *files, "--as", "samples", "--scene", "noise", "--seed", 9, "-o", "seq.exr")
    channels, header = read_by_all(tmp_path / "seq.exr")
    assert (header["nst.terms"], header["nst.scene"]) == ("4,8,12,16,20,24", "noise")
    assert (header["nst.seed"], header["nst.folds"], header["samplesPerPixel"]) == ("9", "4", 24)

    exact = samples.astype(np.float64)
    sums = np.cumsum(exact, axis=0)
    for k in range(6):
        assert same_bits(channels[f"S{4 * k + 4:04}.Y"], (sums[k] / (k + 1)).astype(np.float32)), k
    assert same_bits(channels["Y"], channels["S0024.Y"])
    for fold in range(4):
        mean = exact[fold::4].mean(axis=0).astype(np.float32)
        assert same_bits(channels[f"fold{fold}.Y"], mean), fold
    # Another order of summation: f64 leaves some bits of doubt, f32 almost none.
    variance = exact.var(axis=0, ddof=1) / 6
    np.testing.assert_allclose(channels["Variance.Y"], variance, rtol=1e-6)


def test_packed_estimates(nst: Nst, tmp_path: Path) -> None:
    random = np.random.default_rng(2)
    names = {1: "b-1spp.exr", 4: "a-4spp.exr", 16: "c-16spp.exr"}
    written = {}
    for count, name in names.items():
        written[count] = {c: random.random((HEIGHT, WIDTH), np.float32) for c in "RGB"}
        write_openexr(tmp_path / name, written[count])
    said = nst("pack", *sorted(names.values()), "--as", "estimates", "-o", "seq.exr")
    assert "of 1, 4, 16 samples per pixel (the files' names)" in said
    channels, header = read_by_all(tmp_path / "seq.exr")
    assert header["nst.terms"] == "1,4,16"
    layers = ("", "S0001.", "S0004.", "S0016.")
    assert sorted(channels) == sorted(layer + color for layer in layers for color in "RGB")
    for count, pixels in written.items():
        assert same_bits(lanes(channels, f"S{count:04}"), lanes(pixels)), count


def test_merged_sequences(nst: Nst, tmp_path: Path) -> None:
    for seed in range(3):
        nst(*RENDER, *LANE, "--seed", seed, "--sequence", f"{seed}.exr", "-o", "x.exr")
    nst("merge", "0.exr", "1.exr", "-o", "01.exr")
    nst("merge", "01.exr", "2.exr", "-o", "all.exr")
    merged, header = read_by_all(tmp_path / "all.exr")
    assert (header["nst.seed"], header["samplesPerPixel"]) == ("0,1,2", 3 * SPP)
    counts = [int(count) for count in str(header["nst.terms"]).split(",")]
    assert counts == [3 * count for count in range(SPP - 7, SPP + 1)]
    parts = [read_openexr(tmp_path / f"{seed}.exr")[0] for seed in range(3)]
    # Rounded twice on the way.
    for count in counts:
        mean = np.mean([lanes(part, f"S{count // 3:04}").astype(np.float64) for part in parts], axis=0)
        np.testing.assert_allclose(lanes(merged, f"S{count:04}"), mean, rtol=2e-7)
    for fold in range(4):
        mean = np.mean([lanes(part, f"fold{fold}").astype(np.float64) for part in parts], axis=0)
        np.testing.assert_allclose(lanes(merged, f"fold{fold}"), mean, rtol=2e-7)
    variance = sum(lanes(part, "Variance").astype(np.float64) for part in parts) / 9
    np.testing.assert_allclose(lanes(merged, "Variance"), variance, rtol=2e-7)
    assert not any(name.startswith("state.") for name in merged)


def test_oiiotool_lists_and_copies_a_sequence(nst: Nst, tmp_path: Path) -> None:
    nst(*RENDER, *LANE, "--sequence", "seq.exr", "-o", "x.exr")

    def oiiotool(*arguments: str) -> str:
        command = [OIIOTOOL, *arguments]
        return subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True).stdout

    said = oiiotool("--info", "-v", "seq.exr")
    for word in (f"{WIDTH} x {HEIGHT:4}, 138 channel", "S0011.R", "fold0.G", "Variance.B", "nst.terms"):
        assert word in said, f"{word} is not in:\n{said}"
    # A copy is the same sequence and gives the same picture. The words of the state go through
    # f32 in OpenImageIO: the copy should not be continued.
    oiiotool("seq.exr", "-o", "copy.exr")
    original, copy = (read_openexr(tmp_path / name)[0] for name in ("seq.exr", "copy.exr"))
    assert sorted(original) == sorted(copy)
    assert all(same_bits(original[name], copy[name]) for name in f32_channels(original))
    for name in ("seq", "copy"):
        nst("transform", f"{name}.exr", "--transform", "families", "--backend", "cpu", "--quiet")
    ours, theirs = (read_openexr(tmp_path / f"{name}.nst.exr")[0] for name in ("seq", "copy"))
    assert all(same_bits(ours[name], theirs[name]) for name in ours)
    assert not same_bits(ours["R"], ours["S.R"])
