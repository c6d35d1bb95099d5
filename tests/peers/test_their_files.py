"""nst reads what other programs write: OpenEXR's Python module, OpenImageIO, Mitsuba 3."""

import json
import re
import subprocess
import sys
from pathlib import Path

import mitsuba as mi
import numpy as np
import OpenEXR
import OpenImageIO as oiio
import pytest

from conftest import REPOSITORY, Nst
from readers import read_openexr, same_bits, write_openexr

WIDTH, HEIGHT = 21, 34
RANDOM = np.random.default_rng(7)
LOSSLESS = ("NO", "RLE", "ZIPS", "ZIP", "PIZ")
LOSSY = ("PXR24", "B44", "B44A", "DWAA", "DWAB")


def noise(dtype: type, count: int = 3) -> np.ndarray:
    """Channels `[channel, y, x]`."""
    pixels = 100 * RANDOM.random((count, HEIGHT, WIDTH)) ** 4
    return pixels.astype(dtype)


def packed_first(nst: Nst, folder: Path, *arguments: object) -> dict[str, np.ndarray]:
    """Packs a file as the only rendering: S_1 is the picture."""
    nst("pack", *arguments, "--as", "samples", "--spp", 1, "-o", "seq.exr", "--quiet")
    channels, _ = read_openexr(folder / "seq.exr")
    first = {name.removeprefix("S0001."): c for name, c in channels.items() if name.startswith("S0001.")}
    assert sorted(first) in (["B", "G", "R"], ["Y"]), sorted(channels)
    return first


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.uint32])
@pytest.mark.parametrize("compression", LOSSLESS)
def test_types_and_lossless_compressions(nst: Nst, tmp_path: Path, dtype: type, compression: str) -> None:
    channels = dict(zip("RGBA", noise(dtype, 4), strict=True))
    compression = getattr(OpenEXR, f"{compression}_COMPRESSION")
    write_openexr(tmp_path / "x.exr", channels, compression=compression)
    packed = packed_first(nst, tmp_path, "x.exr")
    assert sorted(packed) == ["B", "G", "R"]
    for name, pixels in packed.items():
        assert same_bits(pixels, channels[name].astype(np.float32)), name


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
@pytest.mark.parametrize("compression", LOSSY)
def test_lossy_compressions(nst: Nst, tmp_path: Path, dtype: type, compression: str) -> None:
    compression = getattr(OpenEXR, f"{compression}_COMPRESSION")
    write_openexr(tmp_path / "x.exr", dict(zip("RGB", noise(dtype), strict=True)), compression=compression)
    theirs, _ = read_openexr(tmp_path / "x.exr")
    packed = packed_first(nst, tmp_path, "x.exr")
    assert sorted(packed) == ["B", "G", "R"]
    for name, pixels in packed.items():
        expected = theirs[name].astype(np.float32)
        # DWA's inverse cosine transform may round differently by a unit in f16's last place.
        np.testing.assert_allclose(pixels, expected, rtol=2**-10, atol=1e-6, err_msg=name)


def test_tiles(nst: Nst, tmp_path: Path) -> None:
    pixels = noise(np.float32)
    image = np.ascontiguousarray(np.moveaxis(pixels, 0, 2))
    spec = oiio.ImageSpec(WIDTH, HEIGHT, 3, "float")
    spec.tile_width = spec.tile_height = 16
    file = oiio.ImageOutput.create("x.exr")
    assert file.open(str(tmp_path / "x.exr"), spec) and file.write_image(image) and file.close()
    packed = packed_first(nst, tmp_path, "x.exr")
    for i, name in enumerate("RGB"):
        assert same_bits(packed[name], pixels[i]), name


def test_layers_and_single_channels(nst: Nst, tmp_path: Path) -> None:
    names = ["R", "G", "B", "A", "diffuse.R", "diffuse.G", "diffuse.B", "depth.Z", "n.X", "n.Y", "n.Z"]
    channels = dict(zip(names, noise(np.float16, len(names)), strict=True))
    write_openexr(tmp_path / "x.exr", channels)
    for arguments, layer, packed_names in [
        ((), "", "RGB"),
        (("--layer", "diffuse"), "diffuse.", "RGB"),
        (("--layer", "depth"), "depth.Z", "Y"),
        (("--layer", "depth.Z"), "depth.Z", "Y"),
        (("--layer", "n.Y"), "n.Y", "Y"),
        (("--layer", "A"), "A", "Y"),
    ]:
        packed = packed_first(nst, tmp_path, "x.exr", *arguments)
        assert sorted(packed) == sorted(packed_names)
        for name, pixels in packed.items():
            source = layer + name if packed_names == "RGB" else layer
            assert same_bits(pixels, channels[source].astype(np.float32)), (arguments, name)


def test_parts(nst: Nst, tmp_path: Path) -> None:
    beauty, mist = noise(np.float32), noise(np.float16, 1)
    header = {"compression": OpenEXR.PIZ_COMPRESSION, "type": OpenEXR.scanlineimage}
    parts = [
        OpenEXR.Part(dict(header), dict(zip("RGB", beauty, strict=True)), "beauty"),
        OpenEXR.Part(dict(header), {"Y": mist[0]}, "mist"),
    ]
    with OpenEXR.File(parts) as file:
        file.write(str(tmp_path / "x.exr"))
    packed = packed_first(nst, tmp_path, "x.exr", "--layer", "beauty")
    assert all(same_bits(packed[name], beauty[i]) for i, name in enumerate("RGB"))
    packed = packed_first(nst, tmp_path, "x.exr", "--layer", "mist")
    assert same_bits(packed["Y"], mist[0].astype(np.float32))
    info = json.loads(nst("info", "x.exr", "--json"))
    assert [part["layers"] for part in info["parts"]] == [["beauty"], ["mist"]]


def test_data_windows(nst: Nst, tmp_path: Path) -> None:
    """The data window is the picture, wherever it lies."""
    pixels = noise(np.float32, 1)[0]
    low, high = np.array([-3, 5], np.int32), np.array([-4 + WIDTH, 4 + HEIGHT], np.int32)
    display = (np.array([0, 0], np.int32), np.array([99, 99], np.int32))
    write_openexr(tmp_path / "x.exr", {"Y": pixels}, dataWindow=(low, high), displayWindow=display)
    assert same_bits(packed_first(nst, tmp_path, "x.exr")["Y"], pixels)


@pytest.fixture(scope="module")
def box() -> dict[str, object]:
    mi.set_variant("scalar_rgb")
    box = mi.cornell_box()
    box["sensor"]["film"] |= {"width": WIDTH, "height": HEIGHT}
    return box


@pytest.mark.parametrize("component_format", ["float16", "float32"])
def test_mitsuba(nst: Nst, tmp_path: Path, box: dict[str, object], component_format: str) -> None:
    box["sensor"]["film"]["component_format"] = component_format
    scene = mi.load_dict(box)
    for seed in range(8):
        mi.render(scene, spp=2, seed=seed)
        scene.sensors()[0].film().write(str(tmp_path / f"{seed}.exr"))
    files = [f"{seed}.exr" for seed in range(8)]
    nst("pack", *files, "--as", "samples", "--spp", 2, "-o", "seq.exr")
    channels, header = read_openexr(tmp_path / "seq.exr")
    assert header["nst.terms"] == "2,4,6,8,10,12,14,16"
    theirs = [read_openexr(tmp_path / name)[0] for name in files]
    assert theirs[0]["R"].dtype == np.dtype(component_format)
    for name in "RGB":
        mean = np.mean([pixels[name].astype(np.float64) for pixels in theirs], axis=0)
        assert same_bits(channels[name], mean.astype(np.float32)), name
    # A network reads it, and changes it.
    said = json.loads(nst("transform", "seq.exr", "--transform", "families", "--backend", "cpu", "--json"))
    assert said["lanes"] == 3 * WIDTH * HEIGHT
    transformed, _ = read_openexr(tmp_path / "seq.nst.exr")
    assert np.isfinite(transformed["R"]).all() and not same_bits(transformed["R"], channels["R"])
    assert same_bits(transformed["S.R"], channels["R"])


def test_mitsuba_aovs(nst: Nst, tmp_path: Path, box: dict[str, object]) -> None:
    box["sensor"]["film"]["component_format"] = "float32"
    box["integrator"] = {"type": "aov", "aovs": "dd:depth,nn:sh_normal", "image": {"type": "path"}}
    scene = mi.load_dict(box)
    mi.render(scene, spp=1)
    scene.sensors()[0].film().write(str(tmp_path / "x.exr"))
    theirs, _ = read_openexr(tmp_path / "x.exr")
    layers = json.loads(nst("info", "x.exr", "--json"))["parts"][0]["layers"]
    colors = next(layer for layer in layers if f"{layer}.R".removeprefix(".") in theirs)
    chosen = ("--layer", colors) if colors else ()
    packed = packed_first(nst, tmp_path, "x.exr", *chosen)
    for name in "RGB":
        assert same_bits(packed[name], theirs[f"{colors}.{name}".removeprefix(".")]), name
    depth = next(name for name in theirs if name.startswith("dd"))
    packed = packed_first(nst, tmp_path, "x.exr", "--layer", depth)
    assert same_bits(packed["Y"], theirs[depth])


def test_the_documented_example(nst_binary: Path, tmp_path: Path) -> None:
    """Runs the code blocks of docs/interoperability.md as they stand."""
    text = (REPOSITORY / "docs/interoperability.md").read_text()
    script = re.search(r"```python\n(.*?)```", text, re.DOTALL).group(1)
    commands = re.search(r"```sh\n(.*?)```", text, re.DOTALL).group(1)
    assert commands.startswith("python render.py\n"), commands
    (tmp_path / "render.py").write_text(script)
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "nst").symlink_to(nst_binary)
    (tmp_path / "bin" / "python").write_text(f'#!/bin/sh\nexec "{sys.executable}" "$@"\n')
    (tmp_path / "bin" / "python").chmod(0o755)
    done = subprocess.run(
        ["bash", "-euc", f'PATH="$PWD/bin:$PATH"\n{commands}'],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "16 of 64x64 pixels" in done.stdout, done.stdout
    assert "relMSE" in done.stdout, done.stdout
    header = read_openexr(tmp_path / "box.exr")[1]
    assert header["nst.terms"] == ",".join(str(k) for k in range(1, 17))
    assert np.isfinite(read_openexr(tmp_path / "box.nst.exr")[0]["R"]).all()
