"""Renders a scene of this project with Mitsuba 3: a reference that shares no code with ours.

    python tests/peers/mitsuba_reference.py scenes/cornell/cornell.obj \\
        --size 64x64 -o tests/data/reference/cornell-64.exr

K independent renders (K seeds) give, per pixel and channel, their mean (R, G, B)
and the estimated variance of that mean (Variance.R, Variance.G, Variance.B):

    mean = (1/K) sum_k x_k        variance = sum_k (x_k - mean)^2 / (K (K - 1))

Anything in the scene's files that is not translated is an error, so that a
reference never leaves something out.
"""

from __future__ import annotations  # `mi.Scene` does not exist before `mi.set_variant`.

import argparse
import os
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import mitsuba as mi
import numpy as np
import OpenEXR

from mitsuba_scene import translate
from scene_files import SceneError, SceneFiles, read_scene


def mean_and_variance(scene: mi.Scene, seeds: Sequence[int], spp: int) -> tuple[np.ndarray, np.ndarray]:
    """Renders once per seed; returns the mean image and the variance of that mean."""
    total, total_of_squares = 0.0, 0.0
    for done, seed in enumerate(seeds, start=1):
        image = np.array(mi.render(scene, spp=spp, seed=seed), dtype=np.float64)
        total = total + image
        total_of_squares = total_of_squares + image**2
        if done % 16 == 0:
            print(f"{done} of {len(seeds)} renders", file=sys.stderr)
    runs = len(seeds)
    mean = total / runs
    return mean, np.maximum(total_of_squares / runs - mean**2, 0.0) / (runs - 1)


def write_exr(path: Path, mean: np.ndarray, variance: np.ndarray, attributes: dict[str, str | int]) -> None:
    """Writes beside the output and renames, so that a broken run leaves the old file."""
    channels = {}
    for i, name in enumerate("RGB"):
        channels[name] = np.ascontiguousarray(mean[..., i], dtype=np.float32)
        channels[f"Variance.{name}"] = np.ascontiguousarray(variance[..., i], dtype=np.float32)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **attributes}
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        unfinished = os.path.join(folder, path.name)
        OpenEXR.File(header, channels).write(unfinished)
        os.replace(unfinished, path)


def without_normals(files: SceneFiles) -> SceneFiles:
    return replace(files, parts=[replace(part, normals=None) for part in files.parts])


def film_size(text: str) -> tuple[int, int]:
    width, height = text.split("x")
    return int(width), int(height)


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Render a scene with Mitsuba 3 as a reference.")
    parser.add_argument("scene", type=Path, help="OBJ file, with its MTL and TOML beside it")
    parser.add_argument("-o", "--output", type=Path, required=True, help="EXR file to write")
    parser.add_argument("--size", type=film_size, metavar="WxH", help="default: the sidecar's")
    parser.add_argument("--max-depth", type=int, metavar="N", help="default: the sidecar's")
    parser.add_argument("--flat", action="store_true", help="leave out the vertex normals")
    parser.add_argument("--renders", type=int, default=64, help="independent renders, 2 or more")
    parser.add_argument("--spp", type=int, default=256, help="samples per pixel of each render")
    parser.add_argument("--seed", type=int, default=1, help="seed of the first render")
    parser.add_argument("--variant", default="llvm_ad_rgb", help="scalar_rgb needs no LLVM")
    args = parser.parse_args()
    if args.renders < 2:
        parser.error("--renders: a variance needs at least 2")
    if not args.output.parent.is_dir():
        parser.error(f"--output: there is no folder {args.output.parent}")
    return args


def main() -> None:
    args = arguments()
    mi.set_variant(args.variant)
    try:
        files = read_scene(args.scene)
        if args.max_depth is not None:
            files = replace(files, max_depth=args.max_depth)
        if args.flat:
            files = without_normals(files)
        scene = mi.load_dict(translate(files, args.size))
    except (OSError, SceneError) as error:
        sys.exit(f"mitsuba_reference: {error}")
    seeds = range(args.seed, args.seed + args.renders)
    mean, variance = mean_and_variance(scene, seeds, args.spp)
    if not mean.any():
        sys.exit(f"mitsuba_reference: {args.scene}: the picture is black")
    attributes = {
        "mitsuba.version": mi.__version__,
        "mitsuba.variant": args.variant,
        "mitsuba.seeds": f"{seeds[0]} to {seeds[-1]}",
        "mitsuba.scene": args.scene.as_posix(),
        "mitsuba.vertexNormals": "left out" if args.flat else "as in the file",
        "mitsuba.maxDepth": files.max_depth,
        "samplesPerPixel": args.renders * args.spp,
    }
    write_exr(args.output, mean, variance, attributes)

    error = np.sqrt(variance[mean > 0]) / mean[mean > 0]
    middle, high = np.quantile(error, [0.5, 0.99])
    print(
        f"{args.output}: mean RGB {mean.mean(axis=(0, 1))}; relative standard error of a channel "
        f"of a pixel: median {middle:.3%}, 99 % below {high:.3%}; {np.sum(mean == 0)} black"
    )


if __name__ == "__main__":
    main()
