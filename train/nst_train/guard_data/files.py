"""EXR files of the set: sequences without what training does not read, and halves of references."""

from pathlib import Path

import numpy as np
import OpenEXR

Picture = np.ndarray
"""Radiance `[y, x, colour]`."""

LEFT_OUT = ("nst.keep", "nst.maxDepth", "nst.pixel", "nst.russianRoulette", "channels", "chunkCount")
"""Attributes of a sequence that belong to its state, or that are made anew."""


def shorten(sequence: Path, target: Path) -> None:
    """Writes a sequence with its last term alone, and without the state that it could be continued from."""
    with OpenEXR.File(str(sequence), separate_channels=True) as file:
        channels = file.channels()
        header = {name: value for name, value in file.header().items() if name not in LEFT_OUT}
        last = header["nst.terms"].split(",")[-1]
        keep = f"S{int(last):04}."
        kept = {
            name: channel.pixels
            for name, channel in channels.items()
            if not name.startswith("state.") and (not is_term(name) or name.startswith(keep))
        }
    _write(target, {**header, "nst.terms": last}, kept)


def without(sequence: Path, target: Path, features: tuple[str, ...]) -> None:
    """Writes a sequence without features, whose names channels start with."""
    with OpenEXR.File(str(sequence), separate_channels=True) as file:
        channels = {
            name: channel.pixels for name, channel in file.channels().items() if not name.startswith(features)
        }
        header = {
            name: value for name, value in file.header().items() if name not in ("channels", "chunkCount")
        }
    _write(target, header, channels)


def is_term(channel: str) -> bool:
    layer, _, color = channel.rpartition(".")
    return layer[:1] == "S" and layer[1:].isdigit() and len(color) == 1


def samples(path: Path) -> int:
    """Samples per pixel of a picture or a sequence."""
    return int(OpenEXR.File(str(path), header_only=True).header()["samplesPerPixel"])


def read(path: Path) -> Picture:
    with OpenEXR.File(str(path), separate_channels=True) as file:
        channels = file.channels()
        return np.stack([channels[name].pixels.astype(np.float64) for name in "RGB"], axis=-1)


def write_reference(path: Path, radiance: Picture, spp: int) -> None:
    channels = {name: np.ascontiguousarray(radiance[..., i], np.float32) for i, name in enumerate("RGB")}
    _write(path, {"compression": OpenEXR.ZIP_COMPRESSION, "samplesPerPixel": spp}, channels)


def _write(path: Path, header: dict[str, object], channels: dict[str, np.ndarray]) -> None:
    """Beside the file, which then gets its name: one that exists is whole."""
    unfinished = path.with_name("unfinished-" + path.name)
    OpenEXR.File({"type": OpenEXR.scanlineimage, **header}, channels).write(str(unfinished))
    unfinished.replace(path)
