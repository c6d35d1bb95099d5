"""Translates an environment image for Mitsuba 3; README.md says how.

`mi.set_variant` comes first.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from scene_files import SceneError

KEYS = {"radiance", "image", "rotation"}


def environment(table: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Returns Mitsuba's emitter for the sidecar's table."""
    unknown = table.keys() - KEYS
    if unknown or "image" not in table:
        raise SceneError(f"[environment] with {sorted(table)} is not translated")
    bitmap = mi.Bitmap(str(folder / table["image"]))
    bitmap = bitmap.convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, srgb_gamma=False)
    texels = np.array(bitmap) * np.float32(table.get("radiance", [1.0, 1.0, 1.0]))
    return {
        "type": "envmap",
        "bitmap": mi.Bitmap(from_pole_to_pole(texels)),
        "to_world": mi.ScalarTransform4f().rotate([0.0, 1.0, 0.0], table.get("rotation", 0.0)),
    }


def from_pole_to_pole(texels: np.ndarray) -> np.ndarray:
    """Rows for Mitsuba, whose first and last row lie at the poles.

    Ours are the middles of equal bands, and end half a band from the poles. Twice as many rows
    and one more have places at the poles, at the middles of bands, and half way between two of
    these, so that both interpolate the same function.
    """
    between = (texels[:-1] + texels[1:]) / 2
    rows = np.empty((2 * len(texels) + 1, *texels.shape[1:]), np.float32)
    rows[1::2], rows[2:-1:2] = texels, between
    rows[0], rows[-1] = texels[0], texels[-1]
    return rows
