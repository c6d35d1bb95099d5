"""Draws docs/neighbours.png: parts of pictures that docs/neighbours.py makes and measures.

    P="$(tools/python-env docs/requirements-neighbours.txt)"
    $P docs/neighbours_crops.py

It needs what `docs/neighbours.py --make` makes of these scenes. Below each part are the errors of its whole
picture, over those of S. The reference says how bright a row is drawn; what is brighter than white is cut.
Weights of the experts are drawn as colours of light; where S stays, it is black.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np
from neighbours import (
    CACHE,
    DOCS,
    METHODS,
    OIDN,
    PLAIN,
    errors,
    estimated,
    halves,
    has_reference,
    transformed,
)
from neighbours_make import layers, samples
from PIL import Image, ImageDraw, ImageFont

GUARD = "auto lane,filter,oidn"
SPP, RUN = 32, 0
TITLES = {
    PLAIN: f"plain, {SPP} spp",
    OIDN: "Open Image Denoise",
    GUARD: "nst's guard",
}
# The colours of experts' weights, and what is written below them.
EXPERTS = ("lane", "filter", "oidn")
COLOURS = "red lane, green filter, blue OIDN"
# Where the part of each scene begins, x and y.
PARTS = {
    "mitsuba-lamps": (48, 44),
    "mitsuba-glass": (60, 60),
    "teapot-glossy": (4, 24),
    "cycles": (28, 44),
}
PART = 64
# This share of the reference's pixels is drawn darker than this share of white.
DARKER, LIGHT = 0.95, 0.8

# Pixels of the drawing. At three a pixel, a row is about as wide as a README.
SCALE = 3
CELL = PART * SCALE
LEFT, GAP, LINE = 28, 6, 26
TEXT, SMALL = ImageFont.load_default(16), ImageFont.load_default(12)


def drawn(colors: np.ndarray, exposure: float, corner: tuple[int, int]) -> Image.Image:
    """The part in sRGB, each pixel as a square."""
    x, y = corner
    linear = np.clip(colors[y : y + PART, x : x + PART] * exposure, 0, 1)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    part = Image.fromarray(np.rint(encoded * 255).astype(np.uint8))
    return part.resize((CELL, CELL), Image.Resampling.NEAREST)


def weights(sequence: Path, options: list[str]) -> np.ndarray:
    """Those of the experts in each pixel, `[y, x, expert]`."""
    with tempfile.TemporaryDirectory() as folder:
        picture = Path(folder) / "picture.exr"
        transformed(sequence, picture, options)
        channels = layers(picture)
        return np.stack([channels[f"weight.{name}"] for name in EXPERTS], axis=-1)


def row_of(scene: str) -> list[tuple[Image.Image, str]]:
    """Each part and what is written below."""
    sequence = CACHE / scene / f"{SPP}-{RUN}.exr"
    both = halves(scene)
    reference = (both[0] + both[1]) / 2
    exposure = LIGHT / np.quantile(reference.mean(axis=-1), DARKER)
    pictures = {method: estimated(sequence, method)[0] for method in TITLES}
    plain = np.array(errors(pictures[PLAIN], both))
    cells = []
    for colors in pictures.values():
        mse, relmse = errors(colors, both) / plain
        part = drawn(colors, exposure, PARTS[scene])
        cells.append((part, f"MSE {mse:.2g}, relMSE {relmse:.2g}"))
    spp = sum(samples(CACHE / scene / f"reference-{i}.exr") for i in (0, 1))
    of_guard = drawn(weights(sequence, METHODS[GUARD]), 1.0, PARTS[scene])
    return [*cells, (drawn(reference, exposure, PARTS[scene]), f"{spp} spp"), (of_guard, COLOURS)]


def label(text: str, width: int, font: ImageFont.FreeTypeFont) -> Image.Image:
    """One line, in the middle."""
    image = Image.new("RGB", (width, LINE), "white")
    ImageDraw.Draw(image).text((width / 2, LINE / 2), text, "black", font, anchor="mm")
    return image


def sheet(titles: list[str], rows: dict[str, list[tuple[Image.Image, str]]]) -> Image.Image:
    """Rows of parts by name, each part with what is written below."""
    step = CELL + LINE + GAP
    image = Image.new("RGB", (LEFT + len(titles) * (CELL + GAP), LINE + len(rows) * step), "white")
    for column, title in enumerate(titles):
        image.paste(label(title, CELL, TEXT), (LEFT + column * (CELL + GAP), 0))
    for row, (name, cells) in enumerate(rows.items()):
        y = LINE + row * step
        for column, (part, below) in enumerate(cells):
            x = LEFT + column * (CELL + GAP)
            image.paste(part, (x, y))
            image.paste(label(below, CELL, SMALL), (x, y + CELL))
        image.paste(label(name, CELL, TEXT).transpose(Image.Transpose.ROTATE_90), (1, y))
    return image


def main(path: Path) -> None:
    if missing := [scene for scene in PARTS if not has_reference("test", scene)]:
        sys.exit(f"error: docs/neighbours.py --make has not finished {', '.join(missing)}")
    titles = [*TITLES.values(), "reference", "weights"]
    sheet(titles, {scene: row_of(scene) for scene in PARTS}).save(path, optimize=True)


if __name__ == "__main__":
    main(DOCS / "neighbours.png")
