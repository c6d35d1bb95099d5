"""Reads a scene of this project: an OBJ file, its MTL files and the TOML file beside it.

Of these formats, it reads what the scenes in `scenes/` use. Anything else is an error, so that a
reference never leaves something out.
"""

import tomllib
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

Material = dict[str, list[float]]
"""The numbers after each keyword of the material."""

MATERIAL_KEYWORDS = {"Kd", "Ke", "Ks", "Ni", "d", "illum", "Pr", "Pm", "Ps", "Pc", "Pcr"}


class SceneError(Exception):
    """What is in the scene's files but is not translated by these scripts."""


@dataclass(frozen=True)
class Part:
    """The triangles of one material that all have vertex normals, or all have none."""

    material: str
    positions: np.ndarray
    """[triangle, corner, xyz]."""
    normals: np.ndarray | None
    """[triangle, corner, xyz], as they stand in the file."""


@dataclass(frozen=True)
class SceneFiles:
    """What the files of a scene say."""

    parts: list[Part]
    materials: dict[str, Material]
    camera: dict[str, list[float] | float]
    size: tuple[int, int]
    """Width and height of the film."""
    max_depth: int
    """It counts as Mitsuba's does: 1 is directly seen emission, 2 adds direct light."""
    environment: dict[str, Any] | None
    """The sidecar's table."""
    folder: Path
    """Where the files are, to which the names of images are relative."""

    @property
    def points(self) -> np.ndarray:
        """All corners [n, xyz]."""
        return np.concatenate([part.positions.reshape(-1, 3) for part in self.parts])


def read_scene(path: Path) -> SceneFiles:
    """Reads an OBJ file, and the MTL and TOML files that belong to it."""
    parts, libraries = _read_obj(path)
    materials: dict[str, Material] = {}
    for library in libraries:
        materials |= _read_mtl(library)
    for part in parts:
        if part.material not in materials:
            raise SceneError(f"{path}: there is no material '{part.material}'")

    sidecar_path = path.with_suffix(".toml")
    with sidecar_path.open("rb") as file:
        sidecar = tomllib.load(file)
    unknown = sidecar.keys() - {"camera", "film", "integrator", "environment"}
    if unknown:
        raise SceneError(f"{sidecar_path}: [{min(unknown)}] is not translated")
    width, height = sidecar["film"]["size"]
    max_depth = sidecar["integrator"]["max_depth"]
    environment = sidecar.get("environment")
    size = (width, height)
    return SceneFiles(parts, materials, sidecar["camera"], size, max_depth, environment, path.parent)


def _statements(path: Path) -> Iterator[tuple[int, str, list[str]]]:
    """Yields line number, keyword and arguments of each line of an OBJ or MTL file."""
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        words = line.split("#", 1)[0].split()
        if words:
            yield number, words[0], words[1:]


def _read_obj(path: Path) -> tuple[list[Part], list[Path]]:
    """Returns the triangles, and the paths of the MTL files."""
    vertices: list[list[float]] = []
    normals: list[list[float]] = []
    # By material and whether there are normals: a vertex and a normal for each corner.
    faces: dict[tuple[str, bool], list[list[tuple[int, int]]]] = {}
    libraries: list[Path] = []
    material = None
    for number, keyword, args in _statements(path):
        if keyword == "v":
            vertices.append([float(x) for x in args[:3]])
        elif keyword == "vn":
            normals.append([float(x) for x in args])
        elif keyword == "f":
            if material is None:
                raise SceneError(f"{path}:{number}: a face before the first usemtl")
            smooth = "/" in args[0]
            try:
                corners = [_corner(text, smooth, len(vertices), len(normals)) for text in args]
            except ValueError:
                raise SceneError(f"{path}:{number}: corners must be all v or all v//vn") from None
            # A polygon a b c d … is the fan abc, acd, …
            fan = [[corners[0], b, c] for b, c in pairwise(corners[1:])]
            faces.setdefault((material, smooth), []).extend(fan)
        elif keyword == "usemtl":
            material = args[0]
        elif keyword == "mtllib":
            libraries.append(path.with_name(args[0]))
        elif keyword not in ("o", "g"):
            raise SceneError(f"{path}:{number}: '{keyword}' is not translated")

    all_vertices, all_normals = np.array(vertices), np.array(normals)
    parts = []
    for (name, smooth), triangles in faces.items():
        indices = np.array(triangles)
        corner_normals = all_normals[indices[..., 1]] if smooth else None
        parts.append(Part(name, all_vertices[indices[..., 0]], corner_normals))
    return parts, libraries


def _corner(text: str, smooth: bool, vertices: int, normals: int) -> tuple[int, int]:
    """A corner's vertex and normal, counted from 0; the normal is 0 where there is none."""
    if not smooth:
        return _index(text, vertices), 0
    vertex, normal = text.split("//")
    return _index(vertex, vertices), _index(normal, normals)


def _index(text: str, count: int) -> int:
    """OBJ's indices start at 1, or count back from the last."""
    index = int(text)
    return index - 1 if index > 0 else count + index


def _read_mtl(path: Path) -> dict[str, Material]:
    materials: dict[str, Material] = {}
    for number, keyword, args in _statements(path):
        if keyword == "newmtl":
            material = materials.setdefault(args[0], {})
        elif keyword in MATERIAL_KEYWORDS:
            material[keyword] = [float(x) for x in args]
        else:
            raise SceneError(f"{path}:{number}: '{keyword}' is not translated")
    return materials
