"""Open Image Denoise, as Python's package brings it along: nst-oidn finds it, and gets the same bits of it
as the package's own binding. The program is `crates/nst-oidn/examples/denoise.rs`. `nst` gets the same bits
of bands of a picture as of the whole."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyoidn
import pytest

from conftest import REPOSITORY, Nst
from readers import read_openexr, same_bits

# No multiple of 16, by which the library pads.
WIDTH, HEIGHT = 150, 101
PACKAGE = Path(pyoidn.__file__).parent / "oidn"
# What decides where the library is found.
SEARCHED = ("OIDN_LIBRARY", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH", "VIRTUAL_ENV")

Layers = list[np.ndarray]


def program() -> Path:
    """The program that the environment variable NST_DENOISE names, or that of the debug build."""
    default = REPOSITORY / "target" / "debug" / "examples" / "denoise"
    path = Path(os.environ.get("NST_DENOISE", default))
    if not path.is_file():
        pytest.fail(f"{path} is missing: cargo build -p nst-oidn --example denoise")
    return path


def run(folder: Path, layers: Layers, **variables: str) -> tuple[int, str, np.ndarray | None]:
    """Denoises by Rust: exit code, what it says, and the picture `[y, x, color]` if there is one."""
    names = ("color", "albedo", "normal")[: len(layers)]
    for name, layer in zip(names, layers, strict=True):
        layer.astype("<f4").tofile(folder / name)
    output = folder / "output"
    output.unlink(missing_ok=True)
    environment = {name: value for name, value in os.environ.items() if name not in SEARCHED}
    # A GPU rounds otherwise; the package's binding uses the CPU.
    environment |= {"OIDN_DEFAULT_DEVICE": "cpu", **variables}
    height, width, _ = layers[0].shape
    command = [program(), str(width), str(height), output, *names]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    picture = np.fromfile(output, "<f4").reshape(layers[0].shape) if output.exists() else None
    return done.returncode, done.stderr, picture


@pytest.fixture(scope="module")
def picture() -> tuple[Layers, np.ndarray]:
    """Colours, albedo and normals of a checkerboard that light falls on, all with noise, the colours up to
    20; and the colours without noise."""
    random = np.random.default_rng(1)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    albedo = np.where(((x // 20 + y // 20) % 2 == 0)[..., None], [0.8, 0.3, 0.1], [0.2, 0.5, 0.9])
    slope = np.sin(x / 25)
    normal = np.stack([slope, np.zeros_like(slope), np.sqrt(1 - slope**2)], axis=-1)
    true = albedo * (10 * np.maximum(normal[..., 2:], 0) + 1)
    color = true * random.gamma(2, 1 / 2, true.shape)
    noisy = np.stack([albedo, normal]) + random.normal(0, 0.02, (2, HEIGHT, WIDTH, 3))
    return [np.ascontiguousarray(layer, np.float32) for layer in (color, *noisy)], true


@pytest.mark.parametrize("count", [1, 2, 3])
def test_rust_and_python_get_the_same_bits(
    picture: tuple[Layers, np.ndarray], count: int, tmp_path: Path
) -> None:
    layers, true = picture
    code, says, ours = run(tmp_path, layers[:count], VIRTUAL_ENV=sys.prefix)
    assert code == 0, says
    assert same_bits(ours, pyoidn.denoise(*layers[:count], hdr=True))
    # It is denoised: no identity, which would be the same bits too.
    assert np.square(ours - true).mean() < 0.1 * np.square(layers[0] - true).mean()
    # The comparison sees a layer more or less, and so that the program gives each to the library.
    other = layers[: count - 1] or layers
    assert not same_bits(ours, pyoidn.denoise(*other, hdr=True))


def test_the_package_is_found(picture: tuple[Layers, np.ndarray], tmp_path: Path) -> None:
    colors = picture[0][:1]
    path = f"{sys.prefix}/bin:{os.environ['PATH']}"
    for variables in ({"VIRTUAL_ENV": sys.prefix}, {"PATH": path}):
        code, says, _ = run(tmp_path, colors, **variables)
        assert code == 0, says
        loading, device = says.splitlines()
        assert loading.startswith(f"loading {PACKAGE}/lib/")
        assert loading.endswith(" (of Python's package pyoidn)")
        assert device == "Open Image Denoise 2.5.1 on CPU"
    code, says, _ = run(tmp_path, colors, OIDN_LIBRARY=str(PACKAGE))
    assert code == 0, says
    assert says.splitlines()[0].endswith(" (named by OIDN_LIBRARY)")


@pytest.mark.parametrize("shape", [(1, 1, 3), (1, 7, 3), (7, 1, 3)])
def test_single_pixels_and_rows(shape: tuple[int, ...], tmp_path: Path) -> None:
    color = np.random.default_rng(2).random(shape, np.float32)
    code, says, ours = run(tmp_path, [color], VIRTUAL_ENV=sys.prefix)
    assert code == 0, says
    assert same_bits(ours, pyoidn.denoise(color, hdr=True))


def test_nan_is_refused_as_the_library_takes_it_for_black(
    picture: tuple[Layers, np.ndarray], tmp_path: Path
) -> None:
    color = picture[0][0].copy()
    color[3, 5] = 0
    black = pyoidn.denoise(color, hdr=True)
    color[3, 5] = np.nan
    assert same_bits(pyoidn.denoise(color, hdr=True), black)
    code, says, ours = run(tmp_path, [color], VIRTUAL_ENV=sys.prefix)
    assert code == 1 and ours is None
    assert "color: 3 values are not finite, the first in column 5 of row 3" in says


def test_bands_are_denoised_as_the_whole(nst: Nst, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The guard's expert gets some rows at a time: 224 of a rendering by one thread, and all of a small file.
    What it looks at around them, and from where on, is what the library says."""
    monkeypatch.setenv("OIDN_LIBRARY", str(PACKAGE))
    monkeypatch.setenv("OIDN_DEFAULT_DEVICE", "cpu")
    scene = REPOSITORY / "scenes" / "cornell" / "cornell.obj"
    render = f"render --scene {scene} --size 40x600 --spp 8 --threads 1 --sequence s.exr"
    nst(*render.split(), "--experts", "oidn", "-o", "bands.exr")
    nst("transform", "s.exr", "--experts", "oidn", "-o", "whole.exr")
    bands, whole = (read_openexr(tmp_path / name)[0] for name in ("bands.exr", "whole.exr"))
    for channel in "RGB":
        assert same_bits(bands[channel], whole[channel])
        assert not same_bits(bands[channel], bands[f"S.{channel}"])


def test_errors_of_the_library_are_passed_on(tmp_path: Path) -> None:
    # Its pictures have at most 65,536 pixels in a row.
    color = np.zeros((1, 65_537, 3), np.float32)
    code, says, ours = run(tmp_path, [color], VIRTUAL_ENV=sys.prefix)
    assert code == 1 and ours is None
    assert "failed to give the filter a picture: image size is too large (error 2)" in says
