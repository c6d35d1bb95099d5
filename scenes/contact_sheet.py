"""Renders every scene and puts the pictures side by side into docs/scenes.png.

    "$(tools/python-env)" scenes/contact_sheet.py [--spp 256]

Needs target/release/nst, or the binary that the environment variable NST names,
and the Python environment of the tests.
"""

import argparse
import os
import struct
import subprocess
import sys
import tempfile
import zlib
from pathlib import Path

import numpy as np
import OpenEXR

ROOT = Path(__file__).resolve().parent.parent
SIZE = 240
COLUMNS = 4


def render(scene: Path, spp: int, folder: Path) -> np.ndarray:
    """The plain picture, `[y, x, channel]`, linear."""
    binary = os.environ.get("NST") or ROOT / "target" / "release" / "nst"
    picture = folder / f"{scene.stem}.exr"
    command = [binary, "render", "--scene", scene, "--spp", spp, "--size", f"{SIZE}x{SIZE}"]
    subprocess.run([*map(str, command), "--transform", "none", "--quiet", "-o", str(picture)], check=True)
    with OpenEXR.File(str(picture), separate_channels=True) as file:
        channels = file.channels()
        return np.stack([channels[name].pixels for name in "RGB"], axis=-1)


def srgb_bytes(linear: np.ndarray) -> np.ndarray:
    """8-bit values by the sRGB transfer function (IEC 61966-2-1)."""
    x = np.clip(linear, 0.0, 1.0)
    encoded = np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)
    return (encoded * 255 + 0.5).astype(np.uint8)


def png(pixels: np.ndarray) -> bytes:
    """An RGB PNG file."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    height, width, _ = pixels.shape
    rows = b"".join(b"\0" + row.tobytes() for row in pixels)
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    chunks = chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(rows, 9)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + chunks


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--spp", type=int, default=256)
    args = parser.parse_args()
    scenes = sorted((ROOT / "scenes").glob("*/*.obj"))
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        generate = [sys.executable, ROOT / "scenes" / "generate.py", "big", folder / "big"]
        subprocess.run(generate, check=True, stdout=subprocess.DEVNULL)
        scenes.append(folder / "big" / "big.obj")
        pictures = [render(scene, args.spp, folder) for scene in scenes]
    while len(pictures) % COLUMNS:
        pictures.append(np.ones((SIZE, SIZE, 3), np.float32))
    rows = [np.concatenate(pictures[i : i + COLUMNS], axis=1) for i in range(0, len(pictures), COLUMNS)]
    (ROOT / "docs").mkdir(exist_ok=True)
    (ROOT / "docs" / "scenes.png").write_bytes(png(srgb_bytes(np.concatenate(rows))))
    print(", ".join(scene.stem for scene in scenes))


main()
