"""Writes a scene with colours of vertices, and renders it with Mitsuba 3.

    python tests/peers/mitsuba_vertex_colors.py

The scene's files (tests/data/scenes/vertex-colors) and Mitsuba's scene come from the same tables;
the reference is tests/data/reference/vertex-colors-32.exr. The file's colours are sRGB. Mitsuba
gets them as attributes of the meshes, decoded here and multiplied by the material's colour.
"""

from __future__ import annotations  # `mi.Scene` does not exist before `mi.set_variant`.

import tempfile
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from mitsuba_materials import ROOT, TOML, view, write_reference

FOLDER = ROOT / "scenes" / "vertex-colors"
LAMP = [8.0, 7.0, 6.0]
# By material: Kd, then rows of corners. Faces lie between neighbours of two rows, and face up;
# the lamp's face down, as Mitsuba's lights shine from one side.
KD = {
    "floor": [0.6, 0.5, 0.3],
    "white": [1.0, 1.0, 1.0],
    "half": [0.5, 0.5, 0.5],
    "disney": [0.9, 0.8, 0.7],
    "lamp": [0.0, 0.0, 0.0],
}
DISNEY = {"roughness": 0.4, "metallic": 0.5}
ROWS: dict[str, list[list[tuple[float, float, float]]]] = {
    "floor": [[(-4, 0, 4), (4, 0, 4)], [(-4, 0, -4), (4, 0, -4)]],
    # Slanted.
    "white": [[(-1.9, 0.1, -0.2), (-0.1, 0.4, -0.2)], [(-1.9, 0.5, -1.9), (-0.1, 0.8, -1.9)]],
    # Bent, as a part of a cylinder is.
    "half": [
        [(0.1, 0.1, -0.2), (1.9, 0.1, -0.2)],
        [(0.1, 0.5, -0.6), (1.9, 0.5, -0.6)],
        [(0.1, 0.6, -1.2), (1.9, 0.6, -1.2)],
        [(0.1, 0.3, -1.9), (1.9, 0.3, -1.9)],
    ],
    "disney": [
        [(-1.6, 0.1, 1.8), (0.0, 0.5, 1.8), (1.6, 0.1, 1.8)],
        [(-1.6, 0.2, 0.2), (0.0, 0.6, 0.2), (1.6, 0.2, 0.2)],
    ],
    "lamp": [[(-1, 6, -2), (2, 6, -2)], [(-1, 6, 1), (2, 6, 1)]],
}
COLORED = ["white", "half", "disney"]


def mesh(name: str) -> tuple[list[tuple[float, float, float]], list[tuple[int, int, int]]]:
    """Corners and the triangles between them, numbered from 0."""
    rows = ROWS[name]
    width = len(rows[0])
    faces = []
    for j in range(len(rows) - 1):
        for i in range(width - 1):
            a = j * width + i
            faces += [(a, a + 1, a + 1 + width), (a, a + 1 + width, a + width)]
    return [corner for row in rows for corner in row], faces


def colors() -> dict[str, np.ndarray]:
    """sRGB by material [vertex, rgb], of few digits, so that the file has them exactly."""
    random = np.random.default_rng(1)
    return {n: random.integers(0, 101, (len(mesh(n)[0]), 3)) / 100.0 for n in COLORED}


def decoded(srgb: np.ndarray) -> np.ndarray:
    """Linear RGB (IEC 61966-2-1)."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def write_scene() -> None:
    FOLDER.mkdir(parents=True, exist_ok=True)
    obj, mtl, first = ["mtllib vertex-colors.mtl"], [], 1
    for name, kd in KD.items():
        corners, faces = mesh(name)
        rgb = colors().get(name, np.empty((len(corners), 0)))
        for corner, color in zip(corners, rgb, strict=True):
            obj.append(" ".join(["v", *map(str, corner), *map(str, color)]))
        obj.append(f"usemtl {name}")
        obj += ["f " + " ".join(str(first + k) for k in face) for face in faces]
        first += len(corners)
        mtl += [f"newmtl {name}", "Kd " + " ".join(map(str, kd))]
    mtl += ["Ke " + " ".join(map(str, LAMP))]  # The lamp is the last one.
    disney = f"Pr {DISNEY['roughness']}\nPm {DISNEY['metallic']}"
    text = "\n".join(mtl).replace("newmtl disney", f"newmtl disney\n{disney}") + "\n"
    (FOLDER / "vertex-colors.obj").write_text("\n".join(obj) + "\n")
    (FOLDER / "vertex-colors.mtl").write_text(text)
    (FOLDER / "vertex-colors.toml").write_text(TOML)


def bsdf(name: str) -> dict[str, Any]:
    color: dict[str, Any] = {"type": "rgb", "value": KD[name]}
    if name in COLORED:
        color = {"type": "mesh_attribute", "name": "vertex_color"}
    if name == "disney":
        # The clearcoat's gloss does nothing without clearcoat.
        nested = {"type": "principled", "base_color": color, "specular": 0.5, **DISNEY}
    else:
        nested = {"type": "diffuse", "reflectance": color}
    return {"type": "twosided", "nested": nested}


def shape(name: str, folder: Path) -> mi.Shape:
    corners, faces = mesh(name)
    head = ["ply", "format ascii 1.0", f"element vertex {len(corners)}"]
    head += [f"property float {axis}" for axis in "xyz"] + [f"element face {len(faces)}"]
    head += ["property list uchar int vertex_indices", "end_header"]
    body = [" ".join(map(str, corner)) for corner in corners]
    body += [" ".join(map(str, (3, *face))) for face in faces]
    file = folder / f"{name}.ply"
    file.write_text("\n".join(head + body) + "\n")
    described = {"type": "ply", "filename": str(file), "face_normals": True, "bsdf": bsdf(name)}
    if name == "lamp":
        described["bsdf"] = {"type": "diffuse", "reflectance": {"type": "rgb", "value": 0.0}}
        described["emitter"] = {"type": "area", "radiance": {"type": "rgb", "value": LAMP}}
    loaded = mi.load_dict(described)
    if name in COLORED:
        linear = decoded(colors()[name]) * KD[name]
        loaded.add_attribute("vertex_color", 3, linear.ravel())
    return loaded


def main() -> None:
    # Two sides of reflection need no LLVM, and the picture is small.
    mi.set_variant("scalar_rgb")
    write_scene()
    scene = view()
    with tempfile.TemporaryDirectory() as folder:
        scene.update({name: shape(name, Path(folder)) for name in KD})
        write_reference("vertex-colors", mi.load_dict(scene))


if __name__ == "__main__":
    main()
