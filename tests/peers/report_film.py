"""A small table of results with pictures, made by formulas, and what the report must show of it."""

import csv
import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from browser import Browser
from conftest import REPOSITORY
from readers import Channels, write_openexr

WIDTH, HEIGHT = 48, 30
SPP = (8, 32)
ODD = 'odd <b>&"</script>'
METHODS = ("none", "auto", ODD)
# By which the report knows that table and pictures belong together.
REFERENCE_HASH = "0123456789abcdef"

COLUMNS = """
    scene method spp run mse relmse smape mse_trimmed bias2 predicted_mse load_seconds render_seconds
    transform_seconds transform_warm_seconds io_seconds total_seconds width height reference_mse threads
    machine adapter version schema failure fingerprint seed sampler
    predicted_ratio predicted_low predicted_high reference reference_spp
""".split()  # noqa: SIM905


def stored(picture: np.ndarray) -> np.ndarray:
    """The values `[y, x, rgb]` that a page can store: magnitudes of 8 bits, one exponent a pixel."""
    finite = np.isfinite(picture).all(axis=2, keepdims=True)
    safe = np.where(finite, picture, 0).astype(np.float64)
    unit = 2.0 ** (np.frexp(np.abs(safe).max(axis=2, keepdims=True))[1] - 8)
    unit = np.where(np.rint(np.abs(safe) / unit).max(axis=2, keepdims=True) > 255, 2 * unit, unit)
    return np.where(finite, np.rint(safe / unit) * unit, np.nan)


def srgb(light: np.ndarray) -> np.ndarray:
    """Bytes of linear light (IEC 61966-2-1)."""
    x = np.clip(light, 0, 1)
    return np.rint(255 * np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055))


def filmic(x: np.ndarray) -> np.ndarray:
    """Narkowicz's fit of the ACES curve."""
    x = np.maximum(x, 0)
    return x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14)


def shown(picture: np.ndarray, stops: float = 0.0, curve: str = "srgb") -> np.ndarray:
    """The bytes `[y, x, rgb]` of a picture on the screen; magenta where it is not finite."""
    exposed = picture * 2.0**stops
    light = filmic(exposed) if curve == "filmic" else exposed
    finite = np.isfinite(picture).all(axis=2, keepdims=True)
    return np.where(finite, srgb(np.nan_to_num(light)), [255, 0, 255])


def shown_errors(picture: np.ndarray, reference: np.ndarray) -> np.ndarray:
    """The bytes of an error map, with the palette and the scale of `nst compare --error-map`."""
    source = (REPOSITORY / "crates/nst-files/src/false_color.rs").read_text()
    knots = re.search(r"INFERNO[^=]*= \[(.*?)\n\];", source, re.DOTALL)
    palette = np.array(re.findall(r"\[(\d+), (\d+), (\d+)\]", knots[1]), dtype=float)
    error = ((picture - reference) ** 2 / (reference**2 + 0.01)).mean(axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        place = np.clip(np.log(error / 1e-5) / np.log(1e1 / 1e-5), 0, 1) * (len(palette) - 1)
    knots = np.arange(len(palette))
    colors = [np.rint(np.interp(np.nan_to_num(place), knots, palette[:, c])) for c in range(3)]
    return np.where(np.isnan(error)[..., None], [255, 0, 255], np.stack(colors, axis=2))


@dataclass
class Film:
    """Pictures `[y, x, rgb]` by layer, all of which a page can store without loss."""

    layers: dict[str, np.ndarray] = field(default_factory=dict)

    @classmethod
    def make(cls) -> "Film":
        random = np.random.default_rng(7)
        y, x = np.mgrid[:HEIGHT, :WIDTH]
        smooth = np.stack([x / WIDTH, y / HEIGHT, (x + y) % 7 / 7], axis=2)
        # Nine orders of magnitude, and black.
        reference = smooth * 10.0 ** (x // 5 - 5)[..., None] * (y % 11 != 3)[..., None]
        layers = {"": reference}
        for method in METHODS:
            for spp in SPP:
                noise = random.normal(0, 1 / spp**0.5, reference.shape)
                # Transformed estimates may be below 0.
                layers[f"{method}.{spp}"] = reference * (1 + (3 if method == ODD else 1) * noise)
        layers["none.8"][4, 5] = layers["none.8"][6, 7] = np.nan
        return cls({name: stored(picture) for name, picture in layers.items()})

    def write_exr(self, path: Path) -> None:
        channels: Channels = {}
        for layer, picture in self.layers.items():
            # One channel is enough to make a pixel not finite.
            odd = np.where(np.isnan(picture), [1, np.inf, np.nan], picture).astype(np.float32)
            for i, channel in enumerate("RGB"):
                channels[f"{layer}.{channel}" if layer else channel] = np.ascontiguousarray(odd[:, :, i])
        write_openexr(path, channels, **{"nst.reference": REFERENCE_HASH})


FILM = Film.make()
REFERENCE = FILM.layers[""]


def settle(browser: Browser) -> None:
    """Waits until the pictures that are shown are decoded and drawn."""
    browser.wait("return document.getElementById('canvas').dataset.drawn === 'whole'")


def write_table(path: Path, scene: str = "a <i>scene</i> &amp; more") -> None:
    """Three methods and two sample counts, four runs each; a fourth method that failed."""
    common = {
        "scene": scene, "width": WIDTH, "height": HEIGHT, "reference_mse": 1e-7, "threads": 2,
        "machine": "a processor", "version": "0.0.0", "schema": 6, "reference": REFERENCE_HASH,
    }  # fmt: skip
    rows = []
    for place, method in enumerate(METHODS):
        for spp in SPP:
            for run in range(4):
                mse = [1.0, 0.3, 4.5][place] / spp * (1 + 0.1 * run)
                seconds = spp / 8 + [0, 0.5, 0.2][place]
                measured = {"mse": mse, "relmse": 2 * mse, "smape": mse**0.5, "total_seconds": seconds}
                rows.append(common | {"method": method, "spp": spp, "run": run} | measured)
    failed = {"method": "failing", "spp": 8, "run": 0, "failure": "it needs <em>more</em> samples"}
    rows.append(common | failed)
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows(rows)
