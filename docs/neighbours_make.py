"""Makes what docs/neighbours.py measures: references and sequences, of three renderers."""

from __future__ import annotations

import os
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Protocol

import numpy as np
import OpenEXR

ROOT = Path(__file__).resolve().parent.parent
NST = os.environ.get("NST", str(ROOT / "target" / "release" / "nst"))
# The interpreter that has Blender's module; see tests/peers/requirements-cycles.txt.
CYCLES_PYTHON = os.environ.get("NST_CYCLES_PYTHON", "")

WIDTH, HEIGHT = 128, 128
RUNS = 2
# Samples per pixel of a sequence, and of each picture that another renderer's sequence is packed from. Roots
# of single samples need pictures of one sample.
COUNTS = {8: 1, 32: 1, 128: 1, 1024: 16}
# What is rendered at a time for a reference, of each of its two halves.
PIECE = 64
# Renders of Mitsuba that go into one film, side by side, times their samples per pixel: more would need much
# memory.
TOGETHER = 32
# The last terms of a sequence that are kept: the guard needs its folds alone.
KEPT_TERMS = 8

Picture = np.ndarray
"""Radiance `[y, x, color]`."""


def seed_of_piece(half: int, piece: int) -> int:
    """No other picture of this scene has it."""
    return (half + 1) * 1_000_000 + piece


def seed_of_run(spp: int, run: int) -> int:
    """The first of a sequence, which has at most as many pictures as samples: no two sequences share one."""
    return 10_000 * (len(COUNTS) * run + list(COUNTS).index(spp))


class Renderer(Protocol):
    def picture(self, spp: int, seed: int) -> Picture: ...
    def sequence(self, spp: int, run: int, path: Path) -> None: ...


def layers(path: Path) -> dict[str, np.ndarray]:
    channels = OpenEXR.File(str(path), separate_channels=True).channels()
    return {name: channel.pixels for name, channel in channels.items()}


def samples(path: Path) -> int:
    """Per pixel, of a reference."""
    return int(OpenEXR.File(str(path), header_only=True).header()["samplesPerPixel"])


def stacked(channels: dict[str, np.ndarray], layer: str = "", names: str = "RGB") -> np.ndarray:
    return np.stack([channels[(f"{layer}." if layer else "") + name] for name in names], axis=-1)


def planes(layer: str, pixels: np.ndarray, names: str = "RGB") -> dict[str, np.ndarray]:
    prefix = f"{layer}." if layer else ""
    return {prefix + name: np.ascontiguousarray(pixels[..., i], np.float32) for i, name in enumerate(names)}


def write(
    path: Path, channels: dict[str, np.ndarray], spp: int, header: dict[str, object] | None = None
) -> None:
    """Beside the file, which then gets its name: one that exists is whole."""
    header = header or {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    unfinished = path.with_name("unfinished-" + path.name)
    OpenEXR.File({**header, "samplesPerPixel": spp}, channels).write(str(unfinished))
    unfinished.replace(path)


def nst(*options: str | Path) -> None:
    subprocess.run([NST, *map(str, options), "--quiet"], check=True, stdout=subprocess.DEVNULL)


def render(seed: int, spp: int, scene: Path, folder: Path, *options: str | Path) -> Path:
    """A picture of `nst render`, of independent samples, without a transform."""
    picture = folder / "picture.exr"
    size = f"{WIDTH}x{HEIGHT}"
    nst(
        *("render", "--scene", scene, "--size", size, "--spp", str(spp), "--seed", str(seed)),
        *("--sampler", "random", "--transform", "none", *options, "-o", picture),
    )
    return picture


class Ours:
    """A scene of this project."""

    def __init__(self, name: str) -> None:
        self.scene = ROOT / "scenes" / name / f"{name}.obj"

    def picture(self, spp: int, seed: int) -> Picture:
        with tempfile.TemporaryDirectory() as folder:
            return stacked(layers(render(seed, spp, self.scene, Path(folder))))

    def sequence(self, spp: int, run: int, path: Path) -> None:
        with tempfile.TemporaryDirectory(dir=path.parent) as folder:
            sequence = Path(folder) / path.name
            seed = seed_of_run(spp, run)
            render(seed, spp, self.scene, Path(folder), "--features", "--sequence", sequence)
            sequence.replace(path)


def pack(pictures: list[Path], spp: int, run: int, path: Path, *options: str) -> None:
    """A sequence of these pictures, `spp` samples per pixel each, with the last of its terms."""
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        packed = Path(folder) / "packed.exr"
        scene = path.parent.name
        nst(
            *("pack", *pictures, "--spp", str(spp), "--scene", scene, "--seed", str(run)),
            *(*options, "-o", packed),
        )
        file = OpenEXR.File(str(packed), separate_channels=True)
        header, channels = file.header(), layers(packed)
        terms = header["nst.terms"].split(",")
        kept = terms[-KEPT_TERMS:]
        for term in set(terms) - set(kept):
            for name in [name for name in channels if name.startswith(f"S{int(term):04}.")]:
                del channels[name]
        header["nst.terms"] = ",".join(kept)
        header = {name: value for name, value in header.items() if name not in ("channels", "chunkCount")}
        write(path, channels, int(terms[-1]), header)


@cache
def mitsuba_scene(name: str):
    import drjit
    import mitsuba as mi

    # Its kernels are compiled by LLVM 19 (tests/peers/README.md).
    mi.set_variant("llvm_ad_rgb")
    drjit.set_thread_count(int(os.environ.get("OMP_NUM_THREADS", os.cpu_count() or 1)))

    from neighbours_scenes import TEST
    from neighbours_tuning import TUNING

    return (TEST | TUNING)[name]()


class Mitsuba:
    """A scene of docs/neighbours_scenes.py. Pictures of one film side by side have samples of their own."""

    def __init__(self, name: str) -> None:
        self.name = name

    @cache  # noqa: B019  There are few scenes, and they are small.
    def loaded(self, together: int):
        import mitsuba as mi

        made = mitsuba_scene(self.name)

        def film(count: int) -> dict[str, object]:
            return {
                "type": "hdrfilm",
                "width": WIDTH * count,
                "height": HEIGHT,
                "pixel_format": "rgb",
                "component_format": "float32",
                "rfilter": {"type": "box"},
            }

        camera = {**made.camera, "film": film(1)}
        cameras = {f"camera{i}": camera for i in range(together)}
        batch = {"type": "batch", "film": film(together), "sampler": {"type": "independent"}, **cameras}
        path = {"type": "path", "max_depth": made.max_depth, "rr_depth": 5}
        features = "albedo:albedo,sh_normal:sh_normal,depth:depth"
        return (
            mi.load_dict({"type": "scene", **made.objects, "sensor": batch}),
            mi.load_dict({"type": "aov", "aovs": features, "inner": path}),
            # With the same seed it has the same samples: the rays of the camera are drawn first.
            mi.load_dict({"type": "path", "max_depth": 1}),
            mi.load_dict(path),
        )

    def pictures(self, together: int, spp: int, seed: int) -> Iterator[dict[str, np.ndarray]]:
        """Channels of each picture."""
        import mitsuba as mi

        scene, integrator, emission, _ = self.loaded(together)
        both = [np.array(mi.render(scene, integrator=i, spp=spp, seed=seed)) for i in (integrator, emission)]
        split = [np.split(pixels, together, axis=1) for pixels in both]
        for pixels, seen in zip(*split, strict=True):
            radiance, albedo, normal, depth = np.split(pixels, [3, 6, 9], axis=-1)
            yield {
                **planes("", radiance),
                **planes("albedo", albedo),
                **planes("sh_normal", normal, "XYZ"),
                **planes("depth", depth, "T"),
                **planes("emission", seen),
            }

    def picture(self, spp: int, seed: int) -> Picture:
        import mitsuba as mi

        scene, _, _, integrator = self.loaded(1)
        return np.array(mi.render(scene, integrator=integrator, spp=spp, seed=seed))

    def sequence(self, spp: int, run: int, path: Path) -> None:
        each = COUNTS[spp]
        together = min(TOGETHER // each, spp // each)
        header = {"compression": OpenEXR.NO_COMPRESSION, "type": OpenEXR.scanlineimage}
        with tempfile.TemporaryDirectory() as folder:
            files: list[Path] = []
            for call in range(spp // each // together):
                for channels in self.pictures(together, each, seed_of_run(spp, run) + call):
                    files.append(Path(folder) / f"{len(files):04}.exr")
                    write(files[-1], channels, each, header)
            pack(files, each, run, path, "--emission", "emission")


class Cycles:
    """The scene of docs/neighbours_cycles.py."""

    def files(self, folder: Path, spp: int, seed: int, count: int) -> list[Path]:
        if not CYCLES_PYTHON:
            raise SystemExit("NST_CYCLES_PYTHON is not set: it names an interpreter that has bpy")
        script = ROOT / "docs" / "neighbours_cycles.py"
        subprocess.run(
            [CYCLES_PYTHON, script, folder, str(spp), str(seed), str(count)],
            check=True,
            stdout=subprocess.DEVNULL,
        )
        return sorted(folder.glob("seed-*.exr"))

    def picture(self, spp: int, seed: int) -> Picture:
        with tempfile.TemporaryDirectory() as folder:
            [file] = self.files(Path(folder), spp, seed, 1)
            return stacked(layers(file), "ViewLayer.Combined")

    def sequence(self, spp: int, run: int, path: Path) -> None:
        with tempfile.TemporaryDirectory() as folder:
            each = COUNTS[spp]
            files = self.files(Path(folder), each, seed_of_run(spp, run), spp // each)
            pack(files, each, run, path)


def extend_reference(renderer: Renderer, path: Path, half: int, spp: int) -> None:
    """Renders pieces until the half has `spp` samples; it is stored after each."""
    done, mean = 0, np.zeros((HEIGHT, WIDTH, 3))
    if path.is_file():
        done = samples(path)
        mean = stacked(layers(path)).astype("f8")
    while done < spp:
        piece = renderer.picture(PIECE, seed_of_piece(half, done // PIECE)).astype("f8")
        done += PIECE
        mean = mean + (piece - mean) * (PIECE / done)
        write(path, planes("", mean), done)


def make(
    renderers: dict[str, Callable[[], Renderer]],
    folder: Path,
    stages: list[tuple[int, list[tuple[int, int]]]],
) -> None:
    """Each stage: samples of the references' halves, at least, and sequences (samples, run)."""
    made = {name: renderer() for name, renderer in renderers.items()}
    for reference_spp, sequences in stages:
        for name, renderer in made.items():
            (folder / name).mkdir(parents=True, exist_ok=True)
            for spp, run in sequences:
                path = folder / name / f"{spp}-{run}.exr"
                if not path.is_file():
                    print(name, f"{spp} samples per pixel, run {run}", flush=True)
                    renderer.sequence(spp, run, path)
            for half in (0, 1):
                path = folder / name / f"reference-{half}.exr"
                print(name, f"reference {half} of {reference_spp} samples per pixel", flush=True)
                extend_reference(renderer, path, half, reference_spp)
