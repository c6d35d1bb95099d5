"""Writes a scene of cut-outs, reliefs and thin glass, and renders it with Mitsuba 3.

    python tests/peers/mitsuba_materials.py

The scene's files (tests/data/scenes/materials) and Mitsuba's scene come from the same tables, and
share nothing else; the reference is tests/data/reference/materials-32.exr. Mitsuba counts the
places where light passes a cut-out as path vertices, and this project does not: of the light of
so many vertices as both may have here, almost nothing is left.
"""

from __future__ import annotations  # `mi.Scene` does not exist before `mi.set_variant`.

import tempfile
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

ROOT = Path(__file__).resolve().parents[1] / "data"
FOLDER = ROOT / "scenes" / "materials"
RENDERS, SPP, DEPTH, SIZE = 64, 512, 16, 32
CAMERA = {"origin": [0.0, 7.0, 3.0], "target": [0.0, 0.0, 0.0], "up": [0.0, 1.0, 0.0]}
FOV = 35.0

# Middle, half extents and height of horizontal squares that face up; texture coordinates grow
# with x and −z from 0 to 1.
SQUARES: dict[str, tuple[float, float, float, float, float]] = {
    "floor": (0.0, 0.0, 4.0, 4.0, 0.0),
    "leaf": (-1.0, -1.0, 0.9, 0.9, 0.5),
    "normals": (1.0, -1.0, 0.9, 0.9, 0.1),
    "bumps": (-1.0, 1.0, 0.9, 0.9, 0.1),
    "pane": (1.0, 1.0, 0.9, 0.9, 0.5),
    "lamp": (0.5, -0.5, 1.5, 1.5, 6.0),
}
MTL = """\
newmtl floor
Kd 0.6 0.5 0.3
newmtl leaf
Kd 0.1 0.6 0.2
map_d -s 2 1 1 mask.png
newmtl normals
Kd 0.7 0.7 0.7
norm normals.png
newmtl bumps
Kd 0.5 0.4 0.7
map_Bump -bm 0.2 bumps.png
newmtl pane
Kd 1 1 1
illum 7
d 0.1
Ni 1.5
newmtl lamp
Kd 0 0 0
Ke 8 7 6
"""
TOML = f"""\
[camera]
position = {CAMERA["origin"]}
target = {CAMERA["target"]}
vertical_fov = {FOV}

[film]
size = [{SIZE}, {SIZE}]

[integrator]
max_depth = {DEPTH}
"""


def corners(name: str) -> list[tuple[float, float, float]]:
    x, z, a, b, y = SQUARES[name]
    return [(x - a, y, z + b), (x + a, y, z + b), (x + a, y, z - b), (x - a, y, z - b)]


def obj(names: list[str], head: str = "") -> str:
    lines = [head, "vt 0 0", "vt 1 0", "vt 1 1", "vt 0 1"]
    for i, name in enumerate(names):
        lines += [f"v {x} {y} {z}" for x, y, z in corners(name)]
        face = " ".join(f"{4 * i + k}/{k}" for k in range(1, 5))
        lines += ([f"usemtl {name}"] if head else []) + [f"f {face}"]
    return "\n".join(lines) + "\n"


def write_scene() -> None:
    FOLDER.mkdir(parents=True, exist_ok=True)
    (FOLDER / "materials.obj").write_text(obj(list(SQUARES), "mtllib materials.mtl"))
    (FOLDER / "materials.mtl").write_text(MTL)
    (FOLDER / "materials.toml").write_text(TOML)
    random = np.random.default_rng(1)
    mask = random.choice([0, 90, 255, 255], (8, 8, 1))
    bumps = random.integers(0, 256, (4, 4, 1))
    # At most 30 degrees from the middle, so that all of them face the camera and the lamp.
    tilt = random.uniform(-0.35, 0.35, (4, 4, 2))
    normals = np.dstack([tilt, np.sqrt(1.0 - (tilt**2).sum(axis=2))])
    normals = np.rint((normals + 1.0) / 2.0 * 255.0)
    for name, pixels in {"mask": mask, "bumps": bumps, "normals": normals}.items():
        mi.Bitmap(np.ascontiguousarray(pixels, dtype=np.uint8)).write(str(FOLDER / f"{name}.png"))


def bitmap(name: str, scale: float = 1.0) -> dict[str, Any]:
    return {
        "type": "bitmap",
        "filename": str(FOLDER / f"{name}.png"),
        "raw": True,
        "to_uv": mi.ScalarTransform3f().scale([scale, 1.0]),
    }


def diffuse(*reflectance: float) -> dict[str, Any]:
    return {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(reflectance)}}


def bsdfs() -> dict[str, dict[str, Any]]:
    normals = {
        "type": "normalmap",
        "normalmap": bitmap("normals"),
        "flip_invalid_normals": False,
        "use_shadowing_function": False,
        "nested": diffuse(0.7, 0.7, 0.7),
    }
    bumps = {
        "type": "bumpmap",
        "heights": bitmap("bumps"),
        "scale": 0.2,
        "nested": diffuse(0.5, 0.4, 0.7),
    }
    leaf = {"type": "twosided", "nested": diffuse(0.1, 0.6, 0.2)}
    return {
        "floor": diffuse(0.6, 0.5, 0.3),
        "leaf": {"type": "mask", "opacity": bitmap("mask", 2.0), "nested": leaf},
        "normals": {"type": "twosided", "nested": normals},
        "bumps": {"type": "twosided", "nested": bumps},
        "pane": {"type": "thindielectric", "int_ior": 1.5, "ext_ior": 1.0},
        "lamp": diffuse(0.0, 0.0, 0.0),
    }


def view() -> dict[str, Any]:
    """A scene without shapes."""
    return {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": DEPTH, "rr_depth": 100},
        "sensor": {
            "type": "perspective",
            "fov": FOV,
            "fov_axis": "y",
            "to_world": mi.ScalarTransform4f().look_at(**CAMERA),
            "film": {
                "type": "hdrfilm",
                "width": SIZE,
                "height": SIZE,
                "pixel_format": "rgb",
                "component_format": "float32",
                "rfilter": {"type": "box"},
            },
            "sampler": {"type": "independent"},
        },
    }


def mitsuba_scene(folder: Path) -> mi.Scene:
    scene = view()
    for name, bsdf in bsdfs().items():
        file = folder / f"{name}.obj"
        file.write_text(obj([name]))
        shape: dict[str, Any] = {
            "type": "obj",
            "filename": str(file),
            "face_normals": True,
            "bsdf": bsdf,
        }
        if name == "lamp":
            # It faces up in the file, and Mitsuba's lights shine from one side.
            shape["flip_normals"] = True
            radiance = {"type": "rgb", "value": [8.0, 7.0, 6.0]}
            shape["emitter"] = {"type": "area", "radiance": radiance}
        scene[name] = shape
    return mi.load_dict(scene)


def write_reference(name: str, scene: mi.Scene) -> None:
    from mitsuba_reference import mean_and_variance, write_exr

    mean, variance = mean_and_variance(scene, range(1, RENDERS + 1), SPP)
    attributes = {
        "mitsuba.version": mi.__version__,
        "mitsuba.seeds": f"1 to {RENDERS}",
        "samplesPerPixel": RENDERS * SPP,
    }
    write_exr(ROOT / "reference" / f"{name}-32.exr", mean, variance, attributes)
    print(f"mean RGB {mean.mean(axis=(0, 1))}")


def main() -> None:
    # Two sides of reflection need no LLVM, and the picture is small.
    mi.set_variant("scalar_rgb")
    write_scene()
    with tempfile.TemporaryDirectory() as folder:
        scene = mitsuba_scene(Path(folder))
        write_reference("materials", scene)


if __name__ == "__main__":
    main()
