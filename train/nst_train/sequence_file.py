"""Reads the sequence files that `nst render --sequence` writes.

One part, f32: channels R, G, B hold S_N, channels S0001.R … hold S_1 …, and the attribute `nst.scene`
names the scene by a fingerprint.
"""

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenEXR

from nst_train.errors import UserError

EXR_MAGIC = b"\x76\x2f\x31\x01"
COLORS = ("R", "G", "B")


@dataclass(frozen=True)
class SequenceFile:
    """An open sequence file; its arrays are `[lane]`, all pixels of R, then of G, then of B."""

    path: Path
    scene: str  # attribute nst.scene
    channels: dict[str, np.ndarray]

    def final(self) -> np.ndarray:
        """S_N."""
        return self._lanes("")

    def terms(self, count: int) -> np.ndarray:
        """S_1 … S_count, `[lane, term]`."""
        return np.stack([self._lanes(f"S{k:04}.") for k in range(1, count + 1)], axis=1)

    def _lanes(self, layer: str) -> np.ndarray:
        return np.concatenate([self._channel(layer + color) for color in COLORS])

    def _channel(self, name: str) -> np.ndarray:
        pixels = self.channels.get(name)
        if pixels is None:
            stored = sum(re.fullmatch(r"S\d{4,}\.R", channel) is not None for channel in self.channels)
            raise UserError(
                f"{self.path}: no channel {name} (it holds {stored} terms); "
                "render it with --keep all and enough --spp"
            )
        if pixels.dtype != np.float32:
            raise UserError(f"{self.path}: channel {name} is {pixels.dtype}, expected float32")
        if not np.isfinite(pixels).all():
            raise UserError(f"{self.path}: channel {name} holds NaN or infinity; render it again")
        return pixels.ravel()


def read(path: Path, size: tuple[int, int]) -> SequenceFile:
    """Opens the file and checks what it is; `size` is (width, height)."""
    try:
        with path.open("rb") as file:
            magic = file.read(len(EXR_MAGIC))
    except OSError as error:
        raise UserError(f"{path}: cannot read the sequence: {error.strerror}") from error
    if magic != EXR_MAGIC:
        raise UserError(f"{path}: not an OpenEXR file")
    try:
        with OpenEXR.File(str(path), separate_channels=True) as file:
            parts = len(file.parts)
            header = dict(file.header())
            channels = {name: channel.pixels for name, channel in file.channels().items()}
    except (RuntimeError, ValueError) as error:
        raise UserError(f"{path}: damaged OpenEXR file; delete it and rerun") from error

    if parts != 1:
        raise UserError(f"{path}: {parts} parts, expected 1")
    if not isinstance(header.get("nst.scene"), str):
        raise UserError(f"{path}: no attribute nst.scene; expected a sequence written by nst")
    low, high = header["dataWindow"]
    found = tuple(int(extent) for extent in high - low + 1)
    if found != size:
        raise UserError(f"{path}: {found[0]}x{found[1]} pixels, expected {size[0]}x{size[1]}")
    return SequenceFile(path, header["nst.scene"], channels)
