"""Mitsuba's scenes for docs/neighbours.py: those of the test, and others to choose parameters by.

All is made of Mitsuba's own shapes and of random numbers with fixed seeds. `mi.set_variant` comes first.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import mitsuba as mi
import numpy as np

Plugin = dict[str, Any]


@dataclass(frozen=True)
class Scene:
    """What a picture is made of, but for its size and samples."""

    objects: dict[str, Plugin]
    camera: Plugin
    max_depth: int


def rgb(*values: float) -> Plugin:
    return {"type": "rgb", "value": list(values) if len(values) == 3 else list(values) * 3}


def diffuse(*color: float) -> Plugin:
    return two_sided({"type": "diffuse", "reflectance": rgb(*color)})


def two_sided(bsdf: Plugin) -> Plugin:
    return {"type": "twosided", "bsdf": bsdf}


def conductor(alpha: float, *color: float) -> Plugin:
    return two_sided({"type": "roughconductor", "alpha": alpha, "specular_reflectance": rgb(*color)})


def plastic(alpha: float, *color: float) -> Plugin:
    return two_sided({"type": "roughplastic", "alpha": alpha, "diffuse_reflectance": rgb(*color)})


def textured(texture: Plugin) -> Plugin:
    return two_sided({"type": "diffuse", "reflectance": texture})


def checkers(scale: float, one: float = 0.1, other: float = 0.8) -> Plugin:
    return {
        "type": "checkerboard",
        "color0": rgb(one),
        "color1": rgb(other),
        "to_uv": mi.ScalarTransform4f().scale([scale, scale, 1]),
    }


def bitmap(pixels: np.ndarray) -> Plugin:
    return {"type": "bitmap", "bitmap": mi.Bitmap(pixels.astype(np.float32)), "raw": True}


def clouds(seed: int, size: int = 128, falloff: float = 1.0) -> np.ndarray:
    """A random texture `[y, x, color]` in [0.05, 0.95], whose amplitude falls as frequency to `-falloff`."""
    random = np.random.default_rng(seed)
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(size), np.fft.fftfreq(size)))
    frequency[0, 0] = 1.0
    noise = np.fft.fft2(random.normal(size=(size, size, 3)), axes=(0, 1)) / frequency[..., None] ** falloff
    field = np.fft.ifft2(noise, axes=(0, 1)).real
    field = (field - field.mean((0, 1))) / field.std((0, 1))
    return np.clip(0.5 + 0.25 * field, 0.05, 0.95)


def lamp(*radiance: float) -> Plugin:
    return {"type": "area", "radiance": rgb(*radiance)}


def place(position: list[float], size: list[float], turn: float = 0.0) -> mi.ScalarTransform4f:
    transform = mi.ScalarTransform4f
    return transform().translate(position) @ transform().rotate([0, 1, 0], turn) @ transform().scale(size)


def box(position: list[float], size: list[float], bsdf: Plugin, turn: float = 0.0) -> Plugin:
    return {"type": "cube", "to_world": place(position, size, turn), "bsdf": bsdf}


def ball(position: list[float], radius: float, bsdf: Plugin | None = None, **more: Any) -> Plugin:
    shape = {"type": "sphere", "center": position, "radius": radius, **more}
    return shape if bsdf is None else {**shape, "bsdf": bsdf}


def rod(start: list[float], end: list[float], radius: float, bsdf: Plugin) -> Plugin:
    return {"type": "cylinder", "p0": start, "p1": end, "radius": radius, "bsdf": bsdf}


def wall(position: list[float], facing: list[float], size: float, bsdf: Plugin, **more: Any) -> Plugin:
    """A square of edge 2 `size`, or a lamp, seen from where it faces."""
    target = [p + f for p, f in zip(position, facing, strict=True)]
    up = [0, 0, 1] if facing[1] else [0, 1, 0]
    transform = mi.ScalarTransform4f
    to_world = transform().look_at(origin=position, target=target, up=up) @ transform().scale([size] * 3)
    return {"type": "rectangle", "to_world": to_world, "bsdf": bsdf, **more}


def ceiling_lamp(position: list[float], size: float, *radiance: float) -> Plugin:
    return wall(position, [0, -1, 0], size, diffuse(0.0), emitter=lamp(*radiance))


def camera(origin: list[float], target: list[float], fov: float, **more: Any) -> Plugin:
    to_world = mi.ScalarTransform4f().look_at(origin=origin, target=target, up=[0, 1, 0])
    return {"type": "perspective", "fov": fov, "to_world": to_world, **more}


def lens(origin: list[float], target: list[float], fov: float, radius: float, distance: float) -> Plugin:
    thin = {"type": "thinlens", "aperture_radius": radius, "focus_distance": distance}
    return camera(origin, target, fov) | thin


def room(walls: Plugin, floor: Plugin, size: float = 3.0, height: float = 4.0) -> dict[str, Plugin]:
    """Floor, ceiling and three walls; open towards the camera, +z."""
    middle = height / 2
    return {
        "floor": wall([0, 0, 0], [0, 1, 0], size, floor),
        "ceiling": wall([0, height, 0], [0, -1, 0], size, walls),
        "back": wall([0, middle, -size], [0, 0, 1], size, walls),
        "left": wall([-size, middle, 0], [1, 0, 0], size, diffuse(0.6, 0.15, 0.1)),
        "right": wall([size, middle, 0], [-1, 0, 0], size, diffuse(0.1, 0.3, 0.6)),
    }


def numbered(name: str, shapes: list[Plugin]) -> dict[str, Plugin]:
    return {f"{name}{i}": shape for i, shape in enumerate(shapes)}


def cornell(max_depth: int) -> Scene:
    """Mitsuba's own, with its lamp in view."""
    parts = mi.cornell_box()
    objects = {name: part for name, part in parts.items() if name not in ("type", "integrator", "sensor")}
    view = {
        key: parts["sensor"][key] for key in ("type", "fov", "fov_axis", "to_world") if key in parts["sensor"]
    }
    return Scene(objects, view, max_depth)


def cornell_glossy() -> Scene:
    scene = cornell(8)
    changed = {
        "small-box": conductor(0.05, 0.9, 0.8, 0.6),
        "large-box": conductor(0.2, 0.8),
        "back": plastic(0.1, 0.6),
        "floor": plastic(0.15, 0.5),
    }
    objects = {
        name: {**part, "bsdf": changed[name]} if name in changed else part
        for name, part in scene.objects.items()
    }
    return Scene(objects, scene.camera, scene.max_depth)


def textures() -> Scene:
    """Checkers of three frequencies and two random textures."""
    objects = room(textured(bitmap(clouds(1))), textured(checkers(12)))
    objects["left"] = wall([-3, 2, 0], [1, 0, 0], 3, textured(checkers(4, 0.3, 0.7)))
    objects["right"] = wall([3, 2, 0], [-1, 0, 0], 3, textured(checkers(48)))
    objects["ball"] = ball([-1, 0.9, -0.5], 0.9, textured(bitmap(clouds(2, falloff=0.5))))
    objects["block"] = box([1.1, 0.8, 0.2], [0.6, 0.8, 0.6], textured(checkers(8)), 30)
    objects["lamp"] = ceiling_lamp([0, 3.99, 0], 0.7, 9)
    return Scene(objects, camera([0, 2, 8.5], [0, 1.8, 0], 38), 6)


def gloss() -> Scene:
    """Balls from nearly mirrors to rough plastic on a floor of plastic, below two lamps and a dim sky."""
    objects: dict[str, Plugin] = {"floor": wall([0, 0, 0], [0, 1, 0], 8, plastic(0.1, 0.3))}
    for row in range(3):
        for column, alpha in enumerate([0.02, 0.06, 0.15, 0.4]):
            tint = [0.95 - 0.25 * row, 0.8, 0.5 + 0.2 * row]
            bsdf = plastic(alpha, *tint) if row == 1 else conductor(alpha, *tint)
            objects[f"ball{row}{column}"] = ball([1.2 * column - 1.8, 0.5, -1.2 * row], 0.5, bsdf)
    objects["warm"] = wall([-4, 4, 3], [4, -4, -3], 0.8, diffuse(0.0), emitter=lamp(18, 14, 9))
    objects["cold"] = wall([5, 5, -2], [-5, -5, 1], 0.5, diffuse(0.0), emitter=lamp(10, 15, 22))
    objects["sky"] = {"type": "constant", "radiance": rgb(0.08, 0.1, 0.14)}
    return Scene(objects, camera([0, 3.2, 5.5], [0, 0.3, -1.1], 36), 6)


def glass() -> Scene:
    """Two glass balls and what they gather, in a room."""
    clear = {"type": "dielectric", "int_ior": 1.5}
    objects = room(diffuse(0.7), diffuse(0.75))
    objects["ball"] = ball([-0.9, 1.0, 0.3], 1.0, clear)
    objects["small"] = ball([1.2, 0.6, 0.9], 0.6, clear)
    objects["block"] = box([1.2, 1.1, -1.4], [0.7, 1.1, 0.7], diffuse(0.7, 0.6, 0.3), 20)
    objects["lamp"] = ceiling_lamp([0, 3.99, 0], 0.5, 20, 18, 15)
    return Scene(objects, camera([0, 2, 8.5], [0, 1.8, 0], 38), 10)


def focus() -> Scene:
    """A lens of large aperture; small lamps out of its focus."""
    random = np.random.default_rng(5)
    objects: dict[str, Plugin] = {"floor": wall([0, 0, 0], [0, 1, 0], 12, textured(checkers(24, 0.2, 0.7)))}
    for i in range(40):
        position = [random.uniform(-4, 4), 0.35, random.uniform(-9, 3)]
        color = random.uniform(0.1, 0.9, 3)
        objects[f"ball{i}"] = ball(position, 0.35, plastic(0.2, *color))
    for i in range(6):
        position = [random.uniform(-3, 3), random.uniform(1, 2.5), random.uniform(-9, -5)]
        objects[f"lamp{i}"] = ball(position, 0.12, emitter=lamp(*random.uniform(20, 60, 3)))
    objects["sky"] = {"type": "constant", "radiance": rgb(0.3, 0.4, 0.55)}
    return Scene(objects, lens([0, 1.6, 6], [0, 0.6, -1], 36, 0.15, 6.5), 4)


def sticks() -> Scene:
    """Hundreds of sticks about a pixel wide, which no neighbour is like."""
    random = np.random.default_rng(6)
    objects: dict[str, Plugin] = {"floor": wall([0, 0, 0], [0, 1, 0], 8, diffuse(0.5))}
    for i in range(400):
        start = np.array([random.uniform(-2.5, 2.5), 0.0, random.uniform(-2.5, 2.5)])
        lean = np.array([random.normal(0, 0.5), random.uniform(1, 2.2), random.normal(0, 0.5)])
        color = random.uniform(0.15, 0.85, 3)
        objects[f"stick{i}"] = rod([*start], [*(start + lean)], 0.02, diffuse(*color))
    objects["lamp"] = wall([3, 5, 3], [-3, -5, -3], 0.7, diffuse(0.0), emitter=lamp(25, 23, 20))
    objects["sky"] = {"type": "constant", "radiance": rgb(0.25, 0.3, 0.4)}
    return Scene(objects, camera([0, 2.4, 6], [0, 0.9, 0], 36), 4)


def tiny_lamps() -> Scene:
    """A hundred and twenty lamps below the size of a pixel, or little above it."""
    random = np.random.default_rng(7)
    objects = room(diffuse(0.6), plastic(0.2, 0.4))
    for i in range(120):
        position = [random.uniform(-2.8, 2.8), random.uniform(0.3, 3.8), random.uniform(-2.8, 1.5)]
        power = random.lognormal(4.2, 0.8) * random.uniform(0.3, 1, 3)
        objects[f"lamp{i}"] = ball(position, random.uniform(0.015, 0.035), emitter=lamp(*power))
    objects["block"] = box([-1, 0.7, -1], [0.7, 0.7, 0.7], diffuse(0.7), 25)
    objects["ball"] = ball([1.2, 0.7, -0.3], 0.7, plastic(0.1, 0.7, 0.5, 0.3))
    return Scene(objects, camera([0, 2, 8.5], [0, 1.8, 0], 38), 4)


TEST: dict[str, Callable[[], Scene]] = {
    "mitsuba-cornell": lambda: cornell(8),
    "mitsuba-cornell-direct": lambda: cornell(2),
    "mitsuba-cornell-glossy": cornell_glossy,
    "mitsuba-textures": textures,
    "mitsuba-gloss": gloss,
    "mitsuba-glass": glass,
    "mitsuba-focus": focus,
    "mitsuba-sticks": sticks,
    "mitsuba-lamps": tiny_lamps,
}
