"""More kinds of places under the sky: houses, stairs, leaves, fences, water, night."""

import numpy as np

from nst_train.random_scenes import images, parts, sets, stuff
from nst_train.random_scenes.files import RandomScene
from nst_train.random_scenes.meshes import rod, surface
from nst_train.random_scenes.parts import Rng
from nst_train.random_scenes.shapes import SQUARE, box, floor, moved, turned


def city(scene: RandomScene, rng: Rng) -> None:
    """Blocks with painted fronts along streets, in the sun, from a roof or the ground."""
    parts.add_quad(scene, rng, parts.matt(rng), floor(40))
    fronts = [scene.material(stuff.painted(scene, rng)) for _ in range(4)]
    street = rng.uniform(0.35, 0.9)
    for x in np.arange(-4, 5) * 1.6:
        for z in np.arange(-6, 2) * 1.6:
            half = np.array([0.8 * (1 - street / 2), 10 ** rng.uniform(-0.5, 0.6), 0.8 * (1 - street / 2)])
            lines = fronts[rng.integers(4)]
            centre = np.array([x + 0.8, half[1], z])
            scene.polygons(lines, box(centre, np.diag(half)), coordinates=[SQUARE * 2] * 6)
    high = rng.random() < 0.6
    position = np.array(
        [0 if not high else rng.uniform(-3, 3), rng.uniform(3.5, 6) if high else rng.uniform(0.3, 1), 5]
    )
    target = np.array([0, 0.8 if high else rng.uniform(0.5, 1.5), -3])
    scene.settings = parts.settings(rng, position, target, rng.uniform(40, 70), int(rng.choice([2, 3, 4, 6])))
    scene.settings += stuff.sun(scene, rng)


def terraces(scene: RandomScene, rng: Rng) -> None:
    """Stairs and steps of a field of blocks, lit by a sky or a sun."""
    lines = stuff.painted(scene, rng) if rng.random() < 0.4 else parts.matt(rng)
    material, other = scene.material(lines), scene.material(parts.any_material(scene, rng))
    count = int(rng.integers(8, 18))
    field = np.round(images.fractal(rng, 32, rng.uniform(0.8, 1.8))[:count, :count] * rng.integers(3, 10)) / 4
    size = 6 / count
    for i in range(count):
        for j in range(count):
            half = np.array([size / 2, field[i, j] / 2 + 0.05, size / 2])
            centre = np.array([(j + 0.5) * size - 3, half[1] - 0.05, (i + 0.5) * size - 4])
            chosen = other if rng.random() < 0.08 else material
            scene.polygons(chosen, box(centre, np.diag(half)), coordinates=[SQUARE] * 6)
    sets.camera_around(scene, rng, depth=int(rng.choice([2, 3, 4, 6])))
    scene.settings += stuff.sun(scene, rng) if rng.random() < 0.5 else parts.sky(scene, rng)


def foliage(scene: RandomScene, rng: Rng) -> None:
    """Trees and shrubs of leaves with cut-out edges, or of small scraps."""
    parts.add_quad(scene, rng, stuff.painted(scene, rng), floor(20), tiles=20)
    y, x = np.mgrid[:32, :32] / 31 * 2 - 1
    leaf = (x**2 + (1.6 * y) ** 2 < 0.9) & (np.abs(y) > 0.03 * rng.integers(0, 3))
    mask = scene.image("bmp", images.bmp(np.repeat(leaf[..., None] * 1.0, 3, axis=-1)))
    for k in range(rng.integers(1, 5)):
        foot = np.array([rng.uniform(-2.2, 2.2), 0, rng.uniform(-2.5, 1)])
        height, spread = rng.uniform(0.4, 2.5), rng.uniform(0.4, 1.1)
        crown = moved(foot, 0, height, 0)
        bark = parts.matt(rng)
        stuff.add_mesh(scene, bark, rod(foot, crown, 0.03 + 0.03 * height))
        for _ in range(rng.integers(2, 7)):
            fork, tip = moved(foot, 0, height * rng.uniform(0.5, 1), 0), crown + rng.normal(0, spread / 2, 3)
            stuff.add_mesh(scene, bark, rod(fork, tip, 0.02))
        cut = f"\nmap_d {mask}" if k == 0 or rng.random() < 0.7 else ""
        leaves = [scene.material(f"{parts.matt(rng)}{cut}") for _ in range(2)]
        size = 10 ** rng.uniform(-1.5, -0.8)
        for _ in range(int(rng.integers(80, 350))):
            a = turned(rng, 1.0) * size
            place = crown + rng.normal(0, 0.5, 3) * spread
            place[1] = max(place[1], 0.05)
            quad = np.array(
                [place - a[0] - a[1], place + a[0] - a[1], place + a[0] + a[1], place - a[0] + a[1]]
            )
            scene.polygons(leaves[rng.integers(2)], [quad], coordinates=[SQUARE])
    sets.camera_around(scene, rng, depth=int(rng.choice([2, 3, 4, 6, 8])))
    scene.settings += stuff.sun(scene, rng) if rng.random() < 0.6 else parts.sky(scene, rng)


def fence(scene: RandomScene, rng: Rng) -> None:
    """Bars, nets and wires before an image or bodies."""
    parts.add_quad(scene, rng, parts.wall_material(scene, rng), floor(20), tiles=10)
    parts.add_quad(
        scene, rng, stuff.painted(scene, rng), moved(sets.back_wall(), 0, 0, rng.uniform(0, 2)), tiles=8
    )
    parts.add_bodies(scene, rng, np.array([2.5, 1.2, 2.0]), int(rng.integers(0, 5)), stuff.anything)
    for _ in range(rng.integers(1, 3)):
        radius, gap, lean = 10 ** rng.uniform(-2.2, -1.3), 10 ** rng.uniform(-1.2, -0.4), rng.normal(0, 0.3)
        z, material = rng.uniform(0.6, 2), scene.material(stuff.anything(scene, rng))
        for x in np.arange(-2.4, 2.4, gap):
            polygons, normals, coordinates = rod(np.array([x, 0, z]), np.array([x + lean, 2.2, z]), radius, 5)
            scene.polygons(material, polygons, normals, coordinates)
        for y in np.arange(0.1, 2.2, gap * rng.choice([1, 4, 30])):
            polygons, normals, coordinates = rod(
                np.array([-2.6, y, z]), np.array([2.6, y + 0.01, z]), radius, 5
            )
            scene.polygons(material, polygons, normals, coordinates)
    position = np.array([rng.uniform(-1.5, 1.5), rng.uniform(0.6, 2), rng.uniform(4, 6)])
    scene.settings = parts.settings(
        rng, position, np.array([0, 1.0, 0]), rng.uniform(28, 45), int(rng.choice([2, 3, 4]))
    )
    if rng.random() < 0.5:
        scene.settings += stuff.sun(scene, rng)
    else:
        centre = np.array([rng.uniform(-4, 4), rng.uniform(2, 5), rng.uniform(3, 6)])
        parts.add_lamp(scene, rng, centre, np.zeros(3), [10 ** rng.uniform(-1.2, 0)] * 2, 5)


def backlight(scene: RandomScene, rng: Rng) -> None:
    """Bodies and bars as dark shapes before a bright sky, which fills much of the picture."""
    parts.add_quad(scene, rng, parts.matt(rng), floor(30))
    parts.add_bodies(scene, rng, np.array([3.0, 1.5, 3.0]), int(rng.integers(2, 9)), stuff.anything)
    for _ in range(rng.integers(0, 25)):
        foot = np.array([rng.uniform(-3, 3), 0, rng.uniform(-3, 1)])
        top = moved(foot, rng.normal(0, 0.4), rng.uniform(1, 3.5), rng.normal(0, 0.4))
        stuff.add_mesh(scene, parts.matt(rng), rod(foot, top, 10 ** rng.uniform(-2.3, -1)))
    position = np.array([rng.uniform(-2, 2), rng.uniform(0.2, 1.2), rng.uniform(4, 6)])
    target = np.array([0, rng.uniform(1, 2.2), 0])
    scene.settings = parts.settings(rng, position, target, rng.uniform(40, 75), int(rng.choice([2, 3, 5])))
    scene.settings += parts.sky(scene, rng) if rng.random() < 0.6 else stuff.sun(scene, rng)


def night(scene: RandomScene, rng: Rng) -> None:
    """Mostly dark: lamps on poles, far from each other, and nearly no sky."""
    parts.add_quad(scene, rng, parts.wall_material(scene, rng), floor(40), tiles=30)
    for _ in range(rng.integers(2, 9)):
        half = rng.uniform(0.3, 1.2, 3)
        centre = np.array([rng.uniform(-6, 6), half[1], rng.uniform(-9, 1)])
        parts.add_box(scene, stuff.anything(scene, rng), centre, np.diag(half))
    for _ in range(rng.integers(1, 7)):
        foot = np.array([rng.uniform(-4, 4), 0, rng.uniform(-9, 1)])
        top = moved(foot, 0, rng.uniform(1.2, 2.5), 0)
        stuff.add_mesh(scene, parts.matt(rng), rod(foot, top, 0.03))
        stuff.add_bulb(
            scene, rng, moved(top, 0, 0.15, 0), 10 ** rng.uniform(-1.6, -0.9), 10 ** rng.uniform(0.5, 2)
        )
    position = np.array([rng.uniform(-2, 2), rng.uniform(0.8, 2.5), rng.uniform(4, 6)])
    scene.settings = parts.settings(
        rng, position, np.array([0, 0.9, -2]), rng.uniform(40, 65), int(rng.choice([2, 3, 4, 6]))
    )
    if rng.random() < 0.5:
        scene.settings += f"\n[environment]\nradiance = [{10 ** rng.uniform(-3, -1.5):.6f}, 0.002, 0.004]\n"


def water(scene: RandomScene, rng: Rng) -> None:
    """A basin with waves over an image: caustics, seen through the surface."""
    parts.add_quad(scene, rng, stuff.painted(scene, rng), floor(2.5), tiles=2)
    sides = box(np.array([0, 1.0, 0]), np.diag([2.5, 1.0, 2.5]))[:2]
    for side in (*sides, moved(sets.back_wall(), 0, 0, 1.5)):
        parts.add_quad(scene, rng, parts.wall_material(scene, rng), side)
    parts.add_bodies(scene, rng, np.array([2.0, 0.8, 2.0]), int(rng.integers(0, 5)))
    count, depth, height = 24, rng.uniform(0.3, 0.8), 10 ** rng.uniform(-2.3, -1.2)
    z, x = (np.mgrid[:count, :count] / (count - 1) - 0.5) * 4.9
    waves = images.fractal(rng, 32, rng.uniform(0.8, 1.6))[:count, :count]
    top = np.stack([x, depth + height * (2 * waves - 1), z], axis=-1)
    low = top * [1, 0, 1] + [0, 0.01, 0]
    # A slab: its sides are one row of quads around it.
    water = scene.material(f"Kd 0 0 0\nKs 1 1 1\nNi {rng.uniform(1.2, 1.5):.6f}\nd 0\nillum 7")
    scene.polygons(water, *surface(top, around=False, along=False)[:2])
    scene.polygons(water, [quad[::-1] for quad in surface(low, around=False, along=False)[0]])
    edge = [(0, j) for j in range(count - 1)] + [(i, count - 1) for i in range(count - 1)]
    edge += [(count - 1, j) for j in range(count - 1, 0, -1)] + [(i, 0) for i in range(count - 1, 0, -1)]
    for k, a in enumerate(edge):
        b = edge[(k + 1) % len(edge)]
        scene.polygons(water, [np.array([top[a], top[b], low[b], low[a]])])
    sets.camera_around(scene, rng, depth=int(rng.choice([6, 8, 12])))
    if rng.random() < 0.5:
        scene.settings += parts.sky(scene, rng)
    else:
        for _ in range(rng.integers(1, 3)):
            centre = np.array([rng.uniform(-2, 2), rng.uniform(2.5, 5), rng.uniform(-1, 2)])
            parts.add_lamp(scene, rng, centre, np.zeros(3), [10 ** rng.uniform(-0.7, 0)] * 2, 3)
        scene.settings += parts.glow(rng)
