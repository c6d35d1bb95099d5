"""Renders all OBJ files of a folder by default settings: a contact sheet, and a CSV file with flags.

    "$(tools/python-env tests/peers/requirements.txt)" tests/peers/obj_sheet.py FOLDER -o OUT

writes OUT/sheet.png and OUT/sheet.csv. A row of the CSV file has the time, the notes or the
error of `nst render`, and what the picture says of itself:

- `refused`, `timeout`, `panic`: there is no picture. A panic is a fault of `nst`, whatever the file;
- `blank`: hardly a pixel of the object differs from the background;
- `flat`: the object's pixels have nearly the same grey. That can be right, for a plane for instance;
- `unmeasured`: there is a picture, but no silhouette.

Which pixels are the object's, a second picture says, the silhouette: the same triangles without
their materials, before a white environment, with directly seen light only. The object is black
there, however it looks in the first picture.
"""

import argparse
import csv
import json
import os
import subprocess
import tempfile
import time
import tomllib
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, fields
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

ROOT = Path(__file__).resolve().parents[2]

# Pixels at the border of the object are a mixture; this many samples tell them from the others.
SILHOUETTE_SPP = 16
# Less than this between the 5th and the 95th percentile of the greys is flat. An object of one
# colour spans 0, and noise at 32 samples per pixel some ten levels.
FLAT_LEVELS = 16
# Values that differ by less are the same: rounding to 8 bits makes 1 of it.
SAME_LEVELS = 2
# An object of which this share differs from the background is blank. Some pixels of an
# invisible object do differ, where paths end before they have left it.
BLANK_SHARE = 0.01
# Pixels of the object that are this near to the background make its outline, and must
# differ from it by so many levels to be seen.
OUTLINE_PIXELS = 2
OUTLINE_LEVELS = 8

LABEL_HEIGHT = 30
MARKS = {"refused": "#c00000", "timeout": "#c00000", "panic": "#c000c0"}


@dataclass
class Row:
    """One file; the fields are the columns of the CSV file."""

    file: str
    seconds: float = 0.0  # of `nst render`, as a user waits for it
    triangles: int | str = ""
    share: float | str = ""  # of the picture's pixels that show some of the object
    levels: float | str = ""  # grey levels of 255 between the object's 5th and 95th percentile
    outline: float | str = ""  # share of the outline that differs from the background
    flags: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    error: str = ""


def near(mask: np.ndarray, distance: int) -> np.ndarray:
    """The pixels with one of the mask at most so many rows and columns away."""
    padded = np.pad(mask, distance)
    height, width = mask.shape
    found = np.zeros_like(mask)
    for y in range(2 * distance + 1):
        for x in range(2 * distance + 1):
            found |= padded[y : y + height, x : x + width]
    return found


def measure(row: Row, picture: Image.Image, silhouette: Image.Image) -> None:
    """Fills in what the picture says of the object, whose pixels are below 255 in the silhouette."""
    rgb = np.asarray(picture.convert("RGB")).astype(int)
    grey = np.asarray(picture.convert("L")).astype(int)
    light = np.asarray(silhouette.convert("L"))
    some, whole = light < 255, light == 0
    row.share = round(float(some.mean()), 4)
    if not some.any():
        row.flags.append("blank")
        return
    # Hair and wires have no pixel of their own.
    low, high = np.percentile(grey[whole if whole.any() else some], [5, 95])
    row.levels = round(float(high - low), 1)
    if high - low < FLAT_LEVELS:
        row.flags.append("flat")
    if some.all():
        return
    background = np.median(rgb[~some], axis=0)
    difference = np.abs(rgb - background).max(axis=-1)
    if (difference[some] >= SAME_LEVELS).mean() < BLANK_SHARE:
        row.flags.append("blank")
    edge = whole & near(~some, OUTLINE_PIXELS)
    if edge.any():
        row.outline = round(float((difference[edge] >= OUTLINE_LEVELS).mean()), 3)


def without_materials(scene: Path, folder: Path) -> Path:
    """A copy of the scene whose faces are all grey, before a white environment."""
    copy = folder / "silhouette.obj"
    lines = scene.read_bytes().splitlines()
    copy.write_bytes(b"\n".join(line for line in lines if not line.lstrip().lower().startswith(b"mtllib")))
    sidecar = "[environment]\nradiance = [1.0, 1.0, 1.0]\n"
    theirs = scene.with_suffix(".toml")
    camera = tomllib.loads(theirs.read_text(encoding="utf-8")).get("camera") if theirs.is_file() else None
    if camera:
        # Numbers and lists of numbers are written alike in JSON and TOML.
        sidecar += "[camera]\n" + "".join(f"{key} = {json.dumps(camera[key])}\n" for key in camera)
    copy.with_suffix(".toml").write_text(sidecar, encoding="utf-8")
    return copy


@dataclass(frozen=True)
class Renderer:
    nst: Path
    size: int
    spp: int
    timeout: float
    threads: int

    def run(self, scene: Path, output: Path, *options: object) -> subprocess.CompletedProcess[str]:
        command = [self.nst, "render", "--scene", scene, "-o", output, "--transform", "none", "--json"]
        command += ["--size", f"{self.size}x{self.size}", "--threads", self.threads, *options]
        return subprocess.run(
            list(map(str, command)),
            capture_output=True,
            text=True,
            errors="replace",
            timeout=self.timeout,
            check=False,
        )

    def row(self, scene: Path, name: str) -> tuple[Row, Image.Image | None]:
        row = Row(name)
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary)
            start = time.perf_counter()
            try:
                done = self.run(scene, folder / "picture.exr", "--spp", self.spp)
            except subprocess.TimeoutExpired:
                row.flags, row.error = ["timeout"], f"took more than {self.timeout:g} s"
                return row, None
            row.seconds = round(time.perf_counter() - start, 3)
            if done.returncode != 0:
                panicked = done.returncode not in (1, 2)
                row.flags = ["panic" if panicked else "refused"]
                row.error = " ".join(done.stderr.split()) or f"exit code {done.returncode}"
                return row, None
            report = json.loads(done.stdout)
            row.notes, row.triangles = report["notes"], report.get("triangles", "")
            picture = Image.open(folder / "picture.png").convert("RGB")
            self.measure(row, picture, scene, folder)
        return row, picture

    def measure(self, row: Row, picture: Image.Image, scene: Path, folder: Path) -> None:
        options = ("--spp", SILHOUETTE_SPP, "--max-depth", 1)
        try:
            done = self.run(without_materials(scene, folder), folder / "silhouette.exr", *options)
            error = done.stderr if done.returncode != 0 else ""
        except subprocess.TimeoutExpired:
            error = f"took more than {self.timeout:g} s"
        if error:
            row.flags, row.error = ["unmeasured"], f"silhouette: {' '.join(error.split())}"
            return
        with Image.open(folder / "silhouette.png") as silhouette:
            measure(row, picture, silhouette)


def wrapped(text: str, width: int, lines: int, font: ImageFont.FreeTypeFont) -> str:
    """The text in lines of so many pixels; what does not fit is left out."""
    rows = [""]
    for letter in text:
        if font.getlength(rows[-1] + letter) > width:
            rows.append("")
        rows[-1] += letter
    return "\n".join(rows[:lines])


def cell(row: Row, picture: Image.Image | None, size: int) -> Image.Image:
    """The picture above the file's name and its flags."""
    font = ImageFont.load_default(11)
    mark = next((MARKS.get(flag, "#d06000") for flag in row.flags), None)
    image = Image.new("RGB", (size, size + LABEL_HEIGHT), "white")
    draw = ImageDraw.Draw(image)
    if picture is None:
        draw.rectangle((0, 0, size - 1, size - 1), "#e8e8e8")
        draw.text((4, 4), wrapped(row.error, size - 8, size // 13, font), MARKS["refused"], font)
    else:
        image.paste(picture)
    name = row.file
    while font.getlength(name) > size - 4:
        name = name[1:]
    draw.text((2, size + 1), name, "black", font)
    numbers = f"  {row.share:.0%} {row.levels:.0f} levels" if isinstance(row.levels, float) else ""
    draw.text((2, size + 14), " ".join(row.flags) + numbers, mark or "#808080", font)
    if mark:
        draw.rectangle((0, 0, size - 1, size - 1), outline=mark, width=3)
    return image


def sheet(cells: list[Image.Image], columns: int) -> Image.Image:
    width, height = cells[0].size
    columns = min(columns, len(cells))
    image = Image.new("RGB", (columns * (width + 4), -(-len(cells) // columns) * (height + 4)), "white")
    for index, part in enumerate(cells):
        image.paste(part, (index % columns * (width + 4), index // columns * (height + 4)))
    return image


def write_csv(path: Path, rows: list[Row]) -> None:
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(column.name for column in fields(Row))
        for row in rows:
            values = (getattr(row, column.name) for column in fields(Row))
            writer.writerow(" | ".join(value) if isinstance(value, list) else value for value in values)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="searched with its folders for *.obj")
    parser.add_argument("-o", "--output", type=Path, required=True, help="a folder")
    parser.add_argument("--nst", type=Path, default=ROOT / "target" / "release" / "nst")
    parser.add_argument("--size", type=int, default=192, help="pixels per side")
    parser.add_argument("--spp", type=int, default=32)
    parser.add_argument("--timeout", type=float, default=120.0, help="seconds for one picture")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="pictures at a time")
    parser.add_argument("--columns", type=int, default=12)
    args = parser.parse_args()
    scenes = sorted(path for path in args.folder.rglob("*") if path.suffix.lower() == ".obj")
    if not scenes:
        parser.error(f"{args.folder} contains no OBJ file")
    if not args.nst.is_file():
        parser.error(f"{args.nst} is missing: cargo build --release, or name another with --nst")

    # Reading is done by one thread: one for each picture leaves none idle.
    renderer = Renderer(args.nst.resolve(), args.size, args.spp, args.timeout, threads=1)

    def render(scene: Path) -> tuple[Row, Image.Image]:
        row, picture = renderer.row(scene, scene.relative_to(args.folder).as_posix())
        return row, cell(row, picture, args.size)

    with ThreadPoolExecutor(args.jobs) as pool:
        rows, cells = zip(*pool.map(render, scenes), strict=True)
    args.output.mkdir(parents=True, exist_ok=True)
    write_csv(args.output / "sheet.csv", list(rows))
    sheet(list(cells), args.columns).save(args.output / "sheet.png")
    flags = Counter(flag for row in rows for flag in row.flags)
    print(f"{len(rows)} files", *(f"{count} {flag}" for flag, count in flags.most_common()), sep=", ")


if __name__ == "__main__":
    main()
