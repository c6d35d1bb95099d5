"""Mitsuba's scenes to choose parameters by; none is in the test of docs/neighbours.py."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from neighbours_scenes import (
    Plugin,
    Scene,
    ball,
    bitmap,
    box,
    camera,
    ceiling_lamp,
    checkers,
    clouds,
    conductor,
    diffuse,
    lamp,
    lens,
    mi,
    plastic,
    rgb,
    rod,
    room,
    textured,
    wall,
)


def hall() -> Scene:
    """Columns in a long hall below lamps that the camera sees."""
    objects = room(textured(bitmap(clouds(11, falloff=1.5))), textured(checkers(6, 0.25, 0.6)), 5, 3.5)
    for i in range(5):
        for side in (-1.6, 1.6):
            z = 2.5 - 1.6 * i
            column = plastic(0.3, 0.7, 0.65, 0.55)
            objects[f"column{i}{side > 0}"] = rod([side, 0, z], [side, 3.5, z], 0.22, column)
        objects[f"lamp{i}"] = ceiling_lamp([0, 3.48, 2.5 - 1.6 * i], 0.25, 22, 20, 16)
    return Scene(objects, camera([0.6, 1.5, 7.5], [0, 1.6, 0], 50), 6)


def sky_map(seed: int) -> np.ndarray:
    """Clouds and a sun, `[y, x, color]`."""
    sky = clouds(seed, falloff=1.6)[:64] * [0.7, 0.9, 1.2]
    sky[18:20, 40:42] = [900, 800, 650]
    sky[32:] *= 0.2
    return sky


def outdoors() -> Scene:
    """Blocks of many colours and a mirror-like ball in the sun, which a picture of the sky contains."""
    random = np.random.default_rng(12)
    objects: dict[str, Plugin] = {"floor": wall([0, 0, 0], [0, 1, 0], 10, textured(bitmap(clouds(13))))}
    for i in range(25):
        half = random.uniform(0.15, 0.5, 3)
        position = [random.uniform(-3, 3), half[1], random.uniform(-4, 1.5)]
        bsdf = diffuse(*random.uniform(0.1, 0.8, 3))
        objects[f"block{i}"] = box(position, [*half], bsdf, random.uniform(0, 90))
    objects["ball"] = ball([0.3, 0.6, 2.2], 0.6, conductor(0.03, 0.9))
    objects["sky"] = {"type": "envmap", "bitmap": mi.Bitmap(sky_map(14).astype(np.float32))}
    return Scene(objects, camera([0, 2.5, 7], [0, 0.6, 0], 40), 4)


def metal() -> Scene:
    """Rough metal blocks between three coloured lamps, one of them in view."""
    random = np.random.default_rng(15)
    objects: dict[str, Plugin] = {
        "floor": wall([0, 0, 0], [0, 1, 0], 8, conductor(0.3, 0.7)),
        "back": wall([0, 3, -4], [0, 0, 1], 6, diffuse(0.5)),
    }
    for i in range(16):
        position = [1.1 * (i % 4) - 1.65, 0.45, 1.1 * (i // 4) - 2.5]
        bsdf = conductor(random.uniform(0.05, 0.5), *random.uniform(0.3, 0.95, 3))
        objects[f"block{i}"] = box(position, [0.3, 0.45, 0.3], bsdf, random.uniform(0, 90))
    objects["red"] = wall([-4, 3, 2], [4, -3, -2], 0.6, diffuse(0.0), emitter=lamp(25, 6, 4))
    objects["blue"] = wall([4, 3, 2], [-4, -3, -2], 0.6, diffuse(0.0), emitter=lamp(4, 8, 25))
    objects["bulb"] = ball([0.8, 2.2, -2.5], 0.25, emitter=lamp(30, 28, 22))
    return Scene(objects, camera([0, 3, 6], [0, 0.8, -1], 42), 5)


def pool() -> Scene:
    """A glass slab over checkers and a rough glass ball: light that is gathered, seen through glass."""
    objects: dict[str, Plugin] = {
        "floor": wall([0, 0, 0], [0, 1, 0], 6, textured(checkers(20, 0.2, 0.8))),
        "back": wall([0, 3, -3], [0, 0, 1], 6, diffuse(0.6, 0.5, 0.4)),
        "slab": box([0.2, 0.35, 0.3], [1.6, 0.2, 1.1], {"type": "dielectric", "int_ior": 1.33}, 12),
        "ball": ball([-1.5, 0.8, -1.2], 0.8, {"type": "roughdielectric", "alpha": 0.1, "int_ior": 1.5}),
        "lamp": ball([1.5, 3.5, 0.5], 0.5, emitter=lamp(25, 24, 20)),
        "sky": {"type": "constant", "radiance": rgb(0.1)},
    }
    return Scene(objects, camera([0, 2.6, 5.5], [0, 0.5, -0.3], 42), 8)


def fence() -> Scene:
    """A grid of thin rods before a wall of noise."""
    objects: dict[str, Plugin] = {
        "back": wall([0, 2, -1.5], [0, 0, 1], 4, textured(bitmap(clouds(16, 256, 0.3)))),
        "floor": wall([0, 0, 0], [0, 1, 0], 4, diffuse(0.4, 0.5, 0.3)),
    }
    for i in range(45):
        x = -2.6 + 0.12 * i
        objects[f"post{i}"] = rod([x, 0, 0], [x + 0.05, 3.4, 0], 0.015, conductor(0.2, 0.8, 0.7, 0.5))
        objects[f"bar{i}"] = rod(
            [-2.7, 0.08 * i, 0.05], [2.7, 0.08 * i + 0.1, 0.05], 0.01, diffuse(0.2, 0.2, 0.6)
        )
    objects["lamp"] = wall([-3, 4, 4], [3, -3, -4], 0.5, diffuse(0.0), emitter=lamp(60, 55, 50))
    return Scene(objects, camera([0, 1.8, 6.5], [0, 1.7, 0], 34), 3)


def bulbs() -> Scene:
    """Rows of bulbs of very different power in a dark room."""
    random = np.random.default_rng(17)
    objects = room(diffuse(0.3), diffuse(0.4), 3, 4)
    for i in range(49):
        position = [0.8 * (i % 7) - 2.4, 0.45 + 0.5 * (i // 7), -2.6]
        power = 10 ** random.uniform(-0.5, 2.3)
        objects[f"bulb{i}"] = ball(position, 0.05, emitter=lamp(*(power * random.uniform(0.4, 1, 3))))
    objects["ball"] = ball([0.8, 0.9, -0.6], 0.9, conductor(0.1, 0.9))
    return Scene(objects, camera([0, 2, 8.5], [0, 1.8, 0], 38), 3)


def still_life() -> Scene:
    """A lens, textures, and one large soft lamp."""
    random = np.random.default_rng(18)
    objects: dict[str, Plugin] = {
        "table": wall([0, 0, 0], [0, 1, 0], 5, textured(bitmap(clouds(19, falloff=0.8)))),
        "back": wall([0, 3, -5], [0, 0, 1], 6, textured(checkers(10, 0.3, 0.6))),
        "lamp": wall([-5, 4, 2], [5, -3, -2], 1.6, diffuse(0.0), emitter=lamp(5, 4.6, 4)),
    }
    for i in range(12):
        size = random.uniform(0.25, 0.6)
        position = [random.uniform(-2, 2), size, random.uniform(-3.5, 1.8)]
        if i % 2:
            objects[f"ball{i}"] = ball(position, size, textured(checkers(6, 0.1, 0.9)))
        else:
            objects[f"block{i}"] = box(
                position, [size] * 3, plastic(0.15, *random.uniform(0.1, 0.8, 3)), 30 * i
            )
    return Scene(objects, lens([0, 2, 6], [0, 0.6, -0.5], 36, 0.2, 6), 5)


def direct() -> Scene:
    """Direct light alone: hard shadows of a grating, and a lamp in view."""
    objects = room(diffuse(0.7), diffuse(0.7))
    for i in range(12):
        objects[f"slat{i}"] = box([0.3 * i - 1.65, 2.6, -0.3], [0.06, 0.05, 1.6], diffuse(0.5))
    objects["block"] = box([-1, 0.6, -0.8], [0.6, 0.6, 0.6], diffuse(0.3, 0.7, 0.3), 35)
    objects["ball"] = ball([1.2, 0.7, 0], 0.7, diffuse(0.8, 0.7, 0.2))
    objects["lamp"] = ball([0.4, 3.5, -0.5], 0.2, emitter=lamp(80, 75, 60))
    return Scene(objects, camera([0, 2, 8.5], [0, 1.8, 0], 38), 2)


TUNING: dict[str, Callable[[], Scene]] = {
    "tuning-hall": hall,
    "tuning-outdoors": outdoors,
    "tuning-metal": metal,
    "tuning-pool": pool,
    "tuning-fence": fence,
    "tuning-bulbs": bulbs,
    "tuning-still-life": still_life,
    "tuning-direct": direct,
}
