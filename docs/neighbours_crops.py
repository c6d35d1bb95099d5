"""Draws docs/neighbours.png: parts of pictures that docs/neighbours.py makes and measures.

    P="$(tools/python-env docs/requirements-neighbours.txt)"
    $P docs/neighbours_crops.py

It needs what `docs/neighbours.py --make` makes of these scenes. Below each part are the errors of its whole
picture, over those of S. The reference says how bright a row is drawn; what is brighter than white is cut.
"""

import sys
from pathlib import Path

import numpy as np
from neighbours import CACHE, DOCS, OIDN, PLAIN, errors, estimated, halves, has_reference
from neighbours_make import samples
from PIL import Image, ImageDraw, ImageFont

GUARD = "auto lane,filter,oidn"
SPP, RUN = 32, 0
TITLES = {
    PLAIN: f"plain, {SPP} spp",
    OIDN: "Open Image Denoise",
    GUARD: "nst's guard",
}
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
TEXT, SMALL = ImageFont.load_default(16), ImageFont.load_default(15)


def drawn(colors: np.ndarray, exposure: float, corner: tuple[int, int]) -> Image.Image:
    """The part in sRGB, each pixel as a square."""
    x, y = corner
    linear = np.clip(colors[y : y + PART, x : x + PART] * exposure, 0, 1)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    part = Image.fromarray(np.rint(encoded * 255).astype(np.uint8))
    return part.resize((CELL, CELL), Image.Resampling.NEAREST)


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
    return [*cells, (drawn(reference, exposure, PARTS[scene]), f"{spp} spp")]


def label(text: str, width: int, font: ImageFont.FreeTypeFont) -> Image.Image:
    """One line, in the middle."""
    image = Image.new("RGB", (width, LINE), "white")
    ImageDraw.Draw(image).text((width / 2, LINE / 2), text, "black", font, anchor="mm")
    return image


def sheet(rows: dict[str, list[tuple[Image.Image, str]]]) -> Image.Image:
    titles = [*TITLES.values(), "reference"]
    step = CELL + LINE + GAP
    image = Image.new("RGB", (LEFT + len(titles) * (CELL + GAP), LINE + len(rows) * step), "white")
    for column, title in enumerate(titles):
        x = LEFT + column * (CELL + GAP)
        image.paste(label(title, CELL, TEXT), (x, 0))
        for row, cells in enumerate(rows.values()):
            part, below = cells[column]
            image.paste(part, (x, LINE + row * step))
            image.paste(label(below, CELL, SMALL), (x, LINE + row * step + CELL))
    for row, scene in enumerate(rows):
        image.paste(label(scene, CELL, TEXT).transpose(Image.Transpose.ROTATE_90), (1, LINE + row * step))
    return image


def main(path: Path) -> None:
    if missing := [scene for scene in PARTS if not has_reference("test", scene)]:
        sys.exit(f"error: docs/neighbours.py --make has not finished {', '.join(missing)}")
    sheet({scene: row_of(scene) for scene in PARTS}).save(path, optimize=True)


if __name__ == "__main__":
    main(DOCS / "neighbours.png")
