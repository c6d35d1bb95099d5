"""What the guard's experts change in directly seen emission, for docs/neighbours_oracle.py.

`nst guard-table` tells of the reflected layer alone, which a network weighs. This looks at the other one as
crates/nst-core/src/guard/picture/panel.rs does: `lane` has all that it changes in pixels that emit, the
denoiser gets the layer by itself, and says as well of all light how much more that is than what surfaces
reflect; what it adds to lanes without emission is not believed.
"""

import tempfile
from pathlib import Path

import numpy as np
import pyoidn
from neighbours import transformed
from neighbours_make import layers, stacked
from oracle_weights import Table

# Brightness, ln(|E|/u + .01), at the first and the last knot.
FLOOR, LOW, HIGH = 0.01, -4.6, 4.9
# The mean that the denoiser's pictures are scaled to; times samples, up to which it is believed.
MEAN, MOST_TIMES = 0.25, 1000.0


def emitted(sequence: Path, table: Table) -> Table | None:
    """The layer of emission as a table, if it is known and there is any; `rest` is S, of both layers."""
    channels = layers(sequence)
    emission = stacked(channels, "emission") if "emission.R" in channels else np.zeros(0)
    if not emission.any():
        return None
    plain = stacked(channels)
    unit = np.abs(plain).mean(dtype=np.float64)
    emits = (emission != 0).any(axis=-1, keepdims=True)
    estimates = {}
    if "lane" in table.experts:
        estimates["lane"] = np.where(emits, emission + lane(sequence) - plain, emission)
    if "oidn" in table.experts:
        guides = stacked(channels, "albedo"), stacked(channels, "normal", "XYZ")
        alone, light, reflected = (
            denoised(colors, *guides, scale=MEAN / unit) for colors in (emission, plain, plain - emission)
        )
        of_all_light = np.maximum(light - reflected, 0)
        # The filter says nothing of emission, and has a place that is free.
        for name, estimate in {"filter": alone, "oidn": of_all_light}.items():
            estimates[name] = np.where(estimate > MOST_TIMES * emission, emission, estimate)
    names = tuple(estimates)
    changes = [np.moveaxis(it - emission, -1, 0).astype(np.float64) for it in estimates.values()]
    seen = np.maximum((emission + np.moveaxis(changes[-1], 0, -1)).mean(axis=-1) / unit, 0)
    knots = table.grid[2]
    places = (np.clip(np.log(seen + FLOOR), LOW, HIGH) - LOW) * (knots - 1) / (HIGH - LOW)
    nothing = np.zeros((*table.grid, 2, len(names)))
    rest = np.moveaxis(plain, -1, 0).astype(np.float64)
    return Table(names, table.cell, nothing[..., :0], nothing, places, np.stack(changes), rest)


def lane(sequence: Path) -> np.ndarray:
    with tempfile.TemporaryDirectory() as folder:
        picture = Path(folder) / "picture.exr"
        transformed(sequence, picture, ["--transform", "auto", "--experts", "lane"])
        return stacked(layers(picture))


def denoised(colors: np.ndarray, albedo: np.ndarray, normal: np.ndarray, scale: float) -> np.ndarray:
    """As `pyoidn.denoise`, with a scale of the colours that is the same for all pictures of a scene."""
    found = np.zeros_like(colors)
    with pyoidn.Device() as device:
        device.commit()
        with pyoidn.Filter(device, pyoidn.OIDN_FILTER_TYPE_RT) as it:
            images = {
                pyoidn.OIDN_IMAGE_COLOR: colors,
                pyoidn.OIDN_IMAGE_ALBEDO: albedo,
                pyoidn.OIDN_IMAGE_NORMAL: normal,
                pyoidn.OIDN_IMAGE_OUTPUT: found,
            }
            for name, pixels in images.items():
                it.set_image(name, pixels, pyoidn.OIDN_FORMAT_FLOAT3)
            it.set_bool("hdr", True)
            it.set_float("inputScale", scale)
            it.commit()
            it.execute()
        if error := device.get_error():
            raise RuntimeError(error)
    return found
