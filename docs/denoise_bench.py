"""Denoises the plain pictures of a bench, so that the bench can judge Open Image Denoise too.

    "$(tools/python-env docs/requirements-denoise.txt)" docs/denoise_bench.py results.csv

reads `results.csv` and `results.exr` of `nst bench scene`, and writes `results-oidn-SPP.exr` for each sample
count beside them. The denoiser is Intel Open Image Denoise on the CPU, filter RT, HDR, with the colours
alone. The files say their samples per pixel, and the time of the whole job: what the plain picture took, by
the table's medians, and the denoising. Then

    nst bench scene … -o results.csv --picture oidn=results-oidn-64.exr …

with the bench's other options adds them to the table.
"""

import csv
import statistics
import sys
import time
from pathlib import Path

import numpy as np
import OpenEXR
import pyoidn

PLAIN = "none"
# Once more than needed: the first call loads the library.
REPEAT = 3


def seconds_of_plain(table: Path) -> dict[int, float]:
    """The median time of the plain picture by sample count."""
    with table.open(newline="", encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["method"] == PLAIN and row["total_seconds"]]
    counts = {int(row["spp"]) for row in rows}
    return {
        spp: statistics.median(float(row["total_seconds"]) for row in rows if int(row["spp"]) == spp)
        for spp in counts
    }


def denoised(picture: np.ndarray) -> tuple[np.ndarray, float]:
    """The denoised picture `[y, x, color]`, and the median time of the calls but for the first."""
    times = []
    for _ in range(REPEAT):
        begin = time.perf_counter()
        result = pyoidn.denoise(np.ascontiguousarray(picture), hdr=True)
        times.append(time.perf_counter() - begin)
    return result, statistics.median(times[1:])


def main(table: Path) -> None:
    channels = OpenEXR.File(str(table.with_suffix(".exr")), separate_channels=True).channels()
    for spp, plain_seconds in sorted(seconds_of_plain(table).items()):
        names = [f"{PLAIN}.{spp}.{color}" for color in "RGB"]
        picture = np.stack([channels[name].pixels for name in names], axis=-1)
        result, seconds = denoised(picture)
        header = {
            "compression": OpenEXR.ZIP_COMPRESSION,
            "type": OpenEXR.scanlineimage,
            "samplesPerPixel": spp,
            "renderTimeSeconds": plain_seconds + seconds,
        }
        path = table.with_name(f"{table.stem}-oidn-{spp}.exr")
        planes = {color: np.ascontiguousarray(result[..., i]) for i, color in enumerate("RGB")}
        OpenEXR.File(header, planes).write(str(path))
        print(f"{path}: {seconds:.3f} s to denoise")


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
