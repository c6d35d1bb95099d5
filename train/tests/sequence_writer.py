"""Writes sequence files as `nst render --sequence` does."""

from pathlib import Path

import numpy as np
import OpenEXR


def write_sequence(path: Path, layers: dict[str, np.ndarray], **attributes: str) -> None:
    """`layers` maps "" (S_N), "S0001." … to pixels `[height, width, color]`.

    `attributes` are written with the prefix `nst.`.
    """
    channels = {
        layer + color: np.ascontiguousarray(pixels[:, :, index])
        for layer, pixels in layers.items()
        for index, color in enumerate("RGB")
    }
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    header |= {f"nst.{key}": value for key, value in attributes.items()}
    OpenEXR.File(header, channels).write(str(path))
