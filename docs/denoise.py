"""Denoises the Cornell box before and after the network: the numbers of figure 7.

    "$(tools/python-env docs/requirements-denoise.txt)" docs/denoise.py PICTURES.npz docs/paper/denoised.csv

PICTURES.npz is what `python -m nst_train.pictures RUN --npz` writes. The denoiser is Intel Open Image
Denoise on the CPU, filter RT, HDR, with the colours alone. Errors are averages over all runs and all lanes
(a channel of a pixel) but those of the lamp, I > 1: they are a hundred times brighter than the rest and
nearly without noise, and where the denoiser puts the lamp's edge would be all that counts. Ratios are to
the MSE of S.
"""

import csv
import sys

import numpy as np
import pyoidn

KEYS = {"n", "S", "T", "I"}
NAME = "cornell-depth-8"


def denoised(pictures: np.ndarray) -> np.ndarray:
    """`[run, y, x, color]`, each picture by itself."""
    return np.stack([pyoidn.denoise(np.ascontiguousarray(p), hdr=True) for p in pictures])


def mse(pictures: np.ndarray, reference: np.ndarray) -> float:
    """mean (x − I)² where I is at most 1, in f64."""
    error = pictures.astype(np.float64) - reference
    return float(np.square(error)[:, reference <= 1.0].mean())


def main(source: str, table: str) -> None:
    data = np.load(source)
    if missing := KEYS - set(data.files):
        sys.exit(f"error: {source}: no array {', '.join(sorted(missing))}")
    reference = data["I"].astype(np.float64)
    rows = []
    for n, s, t in zip(data["n"], data["S"], data["T"], strict=True):
        pictures = {"S": s, "T": t, "OIDN(S)": denoised(s), "OIDN(T)": denoised(t)}
        errors = {method: mse(picture, reference) for method, picture in pictures.items()}
        for method, error in errors.items():
            rows.append((NAME, method, int(n), f"{error:.6g}", f"{error / errors['S']:.6g}"))
    with open(table, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["name", "method", "n", "mse", "mse_ratio"])
        writer.writerows(rows)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
