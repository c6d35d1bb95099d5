"""Translates a scene of this project for Mitsuba 3; README.md says how.

`mi.set_variant` comes first.
"""

from __future__ import annotations  # `mi.Mesh` does not exist before.

from typing import Any

import mitsuba as mi
import numpy as np

from mitsuba_environment import environment
from scene_files import Material, Part, SceneError, SceneFiles

PRINCIPLED = (
    ("Pr", "roughness", 0.5),
    ("Pm", "metallic", 0.0),
    ("Ps", "sheen", 0.0),
    ("Pc", "clearcoat", 0.0),
)
"""Of Disney's BRDF: MTL's keyword, Mitsuba's parameter, default."""

SPECULAR = 0.5
"""The reflectance at normal incidence, in units of 8 %; MTL has no keyword for it."""

GLASS: Material = {"Kd": [0.0] * 3, "Ks": [1.0] * 3, "d": [0.0], "illum": [7.0]}
"""A smooth, clear dielectric, beside its Ni."""

SHEET_GAP = 1e-6
"""Between the two sheets of a light that shines both ways, as a share of the scene's extent.

It lies well above the rounding of distances in f32 (6e-8), so that a ray meets the right sheet
first, and moves each sheet by far less than any reference can resolve."""


def translate(files: SceneFiles, size: tuple[int, int] | None = None) -> dict[str, Any]:
    """Returns the scene for `mi.load_dict`, with a film of `size` or of the file's own."""
    width, height = size or files.size
    camera = files.camera
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {
            "type": "path",
            "max_depth": files.max_depth,
            "rr_depth": 5,
            "hide_emitters": False,
        },
        "sensor": {
            "type": "perspective",
            "fov": camera["vertical_fov"],
            "fov_axis": "y",
            "to_world": mi.ScalarTransform4f().look_at(
                origin=camera["position"],
                target=camera["target"],
                up=camera.get("up", [0.0, 1.0, 0.0]),
            ),
            "film": {
                "type": "hdrfilm",
                "width": width,
                "height": height,
                "pixel_format": "rgb",
                "component_format": "float32",
                "rfilter": {"type": "box"},
            },
            "sampler": {"type": "independent"},
        },
    }
    if files.environment is not None:
        scene["environment"] = environment(files.environment, files.folder)
    powers = [_power(part, files.materials[part.material]) for part in files.parts]
    points = np.vstack([files.points, [camera["position"]]])
    for i, (part, power) in enumerate(zip(files.parts, powers, strict=True)):
        name, material = f"mesh{i}_{part.material}", files.materials[part.material]
        if power > 0.0:
            for side, sheet in enumerate(_sheets(part, points)):
                scene[f"{name}_{side}"] = _mesh(name, sheet, material, power / max(powers))
        else:
            scene[name] = _mesh(name, part, material)
    return scene


def _rgb(value: list[float]) -> dict[str, Any]:
    return {"type": "rgb", "value": value}


def _bsdf(name: str, material: Material) -> dict[str, Any]:
    """Diffuse for Kd alone; Disney's BRDF with one of the keywords that begin with P; glass."""
    if "Kd" not in material:
        raise SceneError(f"material '{name}' has no Kd")
    keywords = material.keys() - {"Ke"}
    color = _rgb(material["Kd"])
    if keywords == {"Kd"}:
        return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": color}}
    if "Ni" in keywords and {key: material[key] for key in keywords - {"Ni"}} == GLASS:
        # Mitsuba's default for the outside is air at 1.000277.
        return {"type": "dielectric", "int_ior": material["Ni"][0], "ext_ior": 1.0}
    if keywords <= {"Kd", "Pcr", *(ours for ours, _, _ in PRINCIPLED)}:
        parameters = {its: material.get(ours, [default])[0] for ours, its, default in PRINCIPLED}
        principled = {
            "type": "principled",
            "base_color": color,
            "specular": SPECULAR,
            "clearcoat_gloss": 1.0 - material.get("Pcr", [0.0])[0],
            **parameters,
        }
        return {"type": "twosided", "bsdf": principled}
    raise SceneError(f"material '{name}': {sorted(keywords)} with these values is not translated")


def _areas(positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals [triangle, xyz] and areas [triangle]."""
    a, b, c = positions[:, 0], positions[:, 1], positions[:, 2]
    normals = np.cross(b - a, c - a)
    lengths = np.linalg.norm(normals, axis=1)
    return normals / lengths[:, None], lengths / 2


def _power(part: Part, material: Material) -> float:
    """Emitted power but for a factor; Mitsuba picks emitters in this proportion."""
    return float(_areas(part.positions)[1].sum() * np.mean(material.get("Ke", 0.0)))


def _sheets(part: Part, points: np.ndarray) -> list[Part]:
    """An emitter as sheets that shine one way, as Mitsuba's do; ours shine both ways.

    A light that has everything on one side, as the one that fills the hole in the Cornell box's
    ceiling has, becomes one sheet that faces that side. Any other becomes two, back to back, with
    a gap between them. The sheets have no vertex normals: emission follows the true surface.
    """
    extent = np.ptp(points, axis=0).max()
    normals, _ = _areas(part.positions)
    front = back = False
    for triangle, normal in zip(part.positions, normals, strict=True):
        heights = (points - triangle[0]) @ normal
        front |= heights.max() > 1e-6 * extent
        back |= heights.min() < -1e-6 * extent
    gap = SHEET_GAP * extent if front and back else 0.0
    lift = gap / 2 * normals[:, None]
    sheets = []
    if front:
        sheets.append(Part(part.material, part.positions + lift, None))
    if back:
        sheets.append(Part(part.material, (part.positions - lift)[:, [0, 2, 1]], None))
    return sheets


def _mesh(name: str, part: Part, material: Material, weight: float = 0.0) -> mi.Mesh:
    """One Mitsuba mesh, shaded smooth if it has normals; an area light if it has a weight."""
    properties = mi.Properties()
    properties["bsdf"] = mi.load_dict(_bsdf(part.material, material))
    if weight > 0.0:
        properties["emitter"] = mi.load_dict(
            {"type": "area", "radiance": _rgb(material["Ke"]), "sampling_weight": weight}
        )
    corners = part.positions.reshape(-1, 3)
    if part.normals is not None:
        normals = part.normals.reshape(-1, 3)
        corners = np.hstack([corners, normals / np.linalg.norm(normals, axis=1, keepdims=True)])
    # Corners that agree in position and normal are one vertex.
    vertices, indices = np.unique(corners, axis=0, return_inverse=True)
    result = mi.Mesh(
        name,
        vertex_count=len(vertices),
        face_count=len(part.positions),
        props=properties,
        has_vertex_normals=part.normals is not None,
    )
    parameters = mi.traverse(result)
    parameters["vertex_positions"] = np.ravel(vertices[:, :3])
    if part.normals is not None:
        parameters["vertex_normals"] = np.ravel(vertices[:, 3:])
    parameters["faces"] = np.ravel(indices)
    parameters.update()
    return result
