"""More kinds of scenes that are about bodies: meshes of formulas, cloths, jewels, panes."""

import numpy as np

from nst_train.random_scenes import images, parts, sets, stuff
from nst_train.random_scenes.files import RandomScene
from nst_train.random_scenes.meshes import bumps, knot, star, superquadric, surface
from nst_train.random_scenes.parts import Rng
from nst_train.random_scenes.shapes import floor, turned


def _light(scene: RandomScene, rng: Rng) -> None:
    """Lamps, a sky, or both; after the camera."""
    kind = rng.random()
    if kind < 0.6:
        parts.add_lamps(scene, rng, np.array([3.5, 2, 3.5]), ceiling=rng.uniform(3, 7))
        scene.settings += parts.glow(rng) if rng.random() < 0.4 else ""
    else:
        scene.settings += parts.sky(scene, rng) if kind < 0.85 else stuff.sun(scene, rng)


def _printed(scene: RandomScene, rng: Rng, rough: bool) -> str:
    return stuff.bumpy(scene, rng) if rough else stuff.painted(scene, rng)


def knots(scene: RandomScene, rng: Rng) -> None:
    """Rings and knots of tubes on a floor."""
    parts.add_quad(scene, rng, parts.wall_material(scene, rng), floor(30), tiles=15)
    for _ in range(rng.integers(1, 6)):
        size = rng.uniform(0.35, 1.1)
        centre = np.array([rng.uniform(-1.8, 1.8), size, rng.uniform(-2, 1.2)])
        stuff.add_mesh(scene, stuff.anything(scene, rng), knot(rng, centre, size))
    sets.camera_around(scene, rng, depth=int(rng.choice([2, 3, 4, 6, 8])))
    _light(scene, rng)


def blobs(scene: RandomScene, rng: Rng) -> None:
    """Lumps with dents, and rounded boxes and octahedra, on a floor or in the air."""
    parts.add_quad(scene, rng, stuff.anything(scene, rng), floor(20), tiles=10)
    for _ in range(rng.integers(2, 9)):
        size = 10 ** rng.uniform(-0.7, 0)
        centre = np.array([rng.uniform(-2, 2), size * rng.uniform(0.9, 2), rng.uniform(-2.2, 1.2)])
        if rng.random() < 0.6:
            shape = bumps(rng, size * 0.8, int(rng.integers(2, 12)), rng.uniform(0.1, 0.5))
        else:
            shape = superquadric(rng.choice([1.0, 1.5, 3.0, 6.0]), size * rng.uniform(0.4, 1, 3))
        stuff.add_mesh(scene, stuff.anything(scene, rng), star(centre, shape))
    sets.camera_around(scene, rng, depth=int(rng.choice([2, 3, 4, 6, 8])))
    _light(scene, rng)


def drapes(scene: RandomScene, rng: Rng) -> None:
    """Hanging and lying cloths with folds, of sheen, coats, bumps and prints."""
    parts.add_quad(scene, rng, parts.matt(rng), floor(20))
    count = 40
    for k in range(rng.integers(1, 4)):
        v, u = np.mgrid[:count, :count] / (count - 1)
        folds = images.fractal(rng, 64, rng.uniform(1, 2))[:count, :count]
        waves = 0.25 * np.sin(u * rng.uniform(6, 40) + 2 * folds) * rng.uniform(0.2, 1)
        x, y = (u - 0.5) * rng.uniform(2, 4), 2.6 * (1 - v)
        points = np.stack([x, y, waves - 1.2 * k + 0.5 * folds], axis=-1)
        if k == 0 and rng.random() < 0.5:
            points = np.stack([x, 0.1 + 0.3 * folds + 0.15 * waves, 3 * v - 1], axis=-1)
        kind = rng.integers(3)
        lines = stuff.cloth(rng) if kind == 0 else _printed(scene, rng, kind == 1)
        stuff.add_mesh(scene, lines, surface(points, around=False, along=False))
    parts.add_bodies(scene, rng, np.array([1.5, 1.0, 1.5]), int(rng.integers(0, 3)), stuff.anything)
    sets.camera_around(scene, rng, depth=int(rng.choice([2, 3, 4, 6])))
    _light(scene, rng)


def jewels(scene: RandomScene, rng: Rng) -> None:
    """Many small bodies of glass and metal under small bright lamps: many small highlights and caustics."""
    parts.add_quad(scene, rng, parts.glossy(rng) if rng.random() < 0.5 else parts.matt(rng), floor(20))
    for _ in range(rng.integers(12, 40)):
        size = 10 ** rng.uniform(-1.3, -0.5)
        centre = np.array([rng.uniform(-1.3, 1.3), size * 1.05, rng.uniform(-1.3, 1)])
        kind = rng.random()
        lines = parts.glass(rng) if kind < 0.4 else parts.mirror(rng) if kind < 0.8 else parts.glossy(rng)
        shape = superquadric(rng.choice([1.0, 1.3, 2.0, 5.0]), size * rng.uniform(0.5, 1, 3))
        stuff.add_mesh(scene, lines, star(centre, shape))
    for _ in range(rng.integers(1, 12)):
        centre = np.array([rng.uniform(-2, 2), rng.uniform(1.5, 4), rng.uniform(-2, 2)])
        stuff.add_bulb(scene, rng, centre, 10 ** rng.uniform(-1.7, -0.7), 15)
    angle, distance = rng.uniform(-0.7, 0.7), rng.uniform(2, 3.5)
    position = np.array([distance * np.sin(angle), rng.uniform(0.5, 1.8), distance * np.cos(angle)])
    scene.settings = parts.settings(
        rng, position, np.array([0, 0.15, 0]), rng.uniform(30, 50), int(rng.choice([4, 6, 8, 12]))
    )
    scene.settings += parts.glow(rng) if rng.random() < 0.6 else ""


def panes(scene: RandomScene, rng: Rng) -> None:
    """Panes of thin glass and half-transparent sheets, before and between bodies."""
    parts.add_quad(scene, rng, stuff.painted(scene, rng), floor(20), tiles=10)
    parts.add_quad(scene, rng, parts.wall_material(scene, rng), sets.back_wall(), tiles=8)
    parts.add_bodies(scene, rng, np.array([2.2, 1.4, 2.2]), int(rng.integers(2, 8)), stuff.anything)
    for _ in range(rng.integers(1, 5)):
        x, z, w, h = (
            rng.uniform(-1.2, 1.2),
            rng.uniform(-1.5, 2),
            rng.uniform(0.4, 1.2),
            rng.uniform(0.5, 1.3),
        )
        turn = turned(rng, 0.1)
        along = turn[0] * w if abs(turn[0][1]) < 0.9 else np.array([w, 0, 0])
        centre, up = np.array([x, h + 0.01, z]), np.array([0, h, 0])
        corners = np.array(
            [centre - along - up, centre + along - up, centre + along + up, centre - along + up]
        )
        lines = parts.glass(rng) if rng.random() < 0.5 else stuff.veil(scene, rng)
        parts.add_quad(scene, rng, lines, corners)
    sets.camera_around(scene, rng, depth=int(rng.choice([3, 4, 6, 8])))
    _light(scene, rng)


def macro(scene: RandomScene, rng: Rng) -> None:
    """A rough surface from near, in light that grazes it."""
    count = 48
    heights = images.fractal(rng, 64, rng.uniform(0.5, 1.6))[:count, :count] * 10 ** rng.uniform(-1.5, -0.3)
    z, x = (np.mgrid[:count, :count] / (count - 1) - 0.5) * 3
    kind = rng.integers(4)
    plain = stuff.cloth(rng) if kind == 0 else parts.glossy(rng)
    lines = plain if kind < 2 else _printed(scene, rng, kind == 2)
    points = np.stack([x, heights, z], axis=-1)
    stuff.add_mesh(scene, lines, surface(points, around=False, along=False))
    for _ in range(rng.integers(0, 8)):
        size = 10 ** rng.uniform(-1.6, -0.7)
        centre = np.array([rng.uniform(-0.8, 0.8), heights.max() + size * 0.5, rng.uniform(-0.8, 0.8)])
        parts.add_ball(scene, stuff.anything(scene, rng), centre, size)
    around = rng.uniform(0, 2 * np.pi)
    lamp = np.array([3 * np.cos(around), rng.uniform(0.4, 2), 3 * np.sin(around)])
    parts.add_lamp(scene, rng, lamp, np.zeros(3), [10 ** rng.uniform(-1.3, 0)] * 2, 1.5)
    position = np.array([rng.uniform(-0.5, 0.5), rng.uniform(0.5, 1.2), rng.uniform(0.8, 1.6)])
    scene.settings = parts.settings(
        rng, position, np.zeros(3), rng.uniform(35, 60), int(rng.choice([2, 3, 4]))
    )
    scene.settings += parts.glow(rng) if rng.random() < 0.5 else ""


def studio(scene: RandomScene, rng: Rng) -> None:
    """One to three bodies of any shape in the renderer's studio, without a floor or on one."""
    if rng.random() < 0.5:
        parts.add_quad(scene, rng, parts.wall_material(scene, rng), floor(4), tiles=4)
    for k in range(rng.integers(1, 4)):
        centre = np.array([1.2 * k - 1, 0.8, rng.uniform(-0.8, 0.5)])
        lines = stuff.anything(scene, rng)
        if rng.random() < 0.5:
            stuff.add_mesh(scene, lines, knot(rng, centre, 0.75))
        else:
            stuff.add_mesh(
                scene, lines, star(centre, bumps(rng, 0.6, int(rng.integers(2, 9)), rng.uniform(0.1, 0.5)))
            )
    sets.camera_around(scene, rng, depth=int(rng.choice([2, 3, 4, 6, 8])))
    scene.settings += (
        f'\n[environment]\nlight = "{rng.choice(["studio", "white", "sky"], p=(0.6, 0.2, 0.2))}"\n'
    )
