"""Little light in much black: dust, sparks and wires, where most pixels of a picture are exactly 0."""

import numpy as np

from nst_train.random_scenes import parts, stuff
from nst_train.random_scenes.files import RandomScene
from nst_train.random_scenes.meshes import rod
from nst_train.random_scenes.parts import Rng
from nst_train.random_scenes.shapes import box, turned

REACH = np.array([1.6, 1.2, 0.8])
"""Half sides of the box that things are in, about the origin."""
SIZES = (-2.4, -1.1)
"""Decimal logarithms of the least and largest half size of a thing; a pixel of 128 is about 0.01 wide."""


def dust(scene: RandomScene, rng: Rng) -> None:
    """Ten to three thousand scraps or crumbs of all sizes, lit by lamps that are not in view."""
    materials = [
        scene.material(parts.matt(rng) if rng.random() < 0.7 else parts.glossy(rng)) for _ in range(8)
    ]
    low, high = np.sort(rng.uniform(*SIZES, 2))
    for _ in range(int(10 ** rng.uniform(1, 3.5))):
        size, place = 10 ** rng.uniform(low, high), rng.uniform(-1, 1, 3) * REACH
        axes = turned(rng, 0.8) * size
        material = materials[rng.integers(len(materials))]
        if rng.random() < 0.5:
            scene.polygons(material, box(place, axes))
        else:
            a, b, _ = axes
            scene.polygons(material, [np.array([place - a - b, place + a - b, place + a + b, place - a + b])])
    lamps(scene, rng)
    seen_in_the_dark(scene, rng)


def sparks(scene: RandomScene, rng: Rng) -> None:
    """Tiny lamps that are seen themselves, one to five hundred, and perhaps crumbs that they light."""
    count = int(10 ** rng.uniform(0, 2.7))
    power = 10 ** rng.uniform(-1, 0.7)
    low, high = np.sort(rng.uniform(*SIZES, 2))
    for _ in range(count):
        place = rng.uniform(-1, 1, 3) * REACH
        stuff.add_bulb(scene, rng, place, 10 ** rng.uniform(low, high), power / count)
    if rng.random() < 0.5:
        parts.add_bodies(scene, rng, REACH, int(rng.integers(1, 12)), lambda _, rng: parts.matt(rng))
    seen_in_the_dark(scene, rng)


def wires(scene: RandomScene, rng: Rng) -> None:
    """Thin rods, five to three hundred, lit by lamps that are not in view."""
    materials = [
        scene.material(parts.matt(rng) if rng.random() < 0.5 else parts.glossy(rng)) for _ in range(4)
    ]
    low, high = np.sort(rng.uniform(SIZES[0], -1.6, 2))
    for _ in range(int(10 ** rng.uniform(0.7, 2.5))):
        ends = rng.uniform(-1, 1, (2, 3)) * REACH
        polygons, normals, coordinates = rod(*ends, 10 ** rng.uniform(low, high))
        scene.polygons(materials[rng.integers(len(materials))], polygons, normals, coordinates)
    lamps(scene, rng)
    seen_in_the_dark(scene, rng)


def lamps(scene: RandomScene, rng: Rng) -> None:
    """One or two beside and above the camera's view, which nothing hides."""
    for _ in range(rng.integers(1, 3)):
        centre = np.array([rng.uniform(-4, 4), rng.uniform(3, 6), rng.uniform(1, 6)])
        parts.add_lamp(scene, rng, centre, np.zeros(3), [10 ** rng.uniform(-1, 0.2)] * 2, power=3)


def seen_in_the_dark(scene: RandomScene, rng: Rng) -> None:
    """The camera in front, and no light but that of the lamps."""
    position = np.array([rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5), rng.uniform(4, 6)])
    depth = int(rng.choice([2, 2, 3, 4]))
    scene.settings = parts.settings(rng, position, np.zeros(3), rng.uniform(22, 40), depth)
