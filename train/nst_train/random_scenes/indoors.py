"""More kinds of rooms: lamps in view, pictures, columns, and light that comes by detours."""

import numpy as np

from nst_train.random_scenes import parts, sets, stuff
from nst_train.random_scenes.files import RandomScene
from nst_train.random_scenes.meshes import lathe, rod, star, superquadric
from nst_train.random_scenes.parts import Rng
from nst_train.random_scenes.shapes import FRONT, SQUARE, box, moved, turned


def lanterns(scene: RandomScene, rng: Rng) -> None:
    """A dark room with few to many bulbs in view, of very different size and power."""
    half = sets.room_size(rng)
    sets.walls(scene, rng, half, left_out=(FRONT,) if rng.random() < 0.5 else ())
    parts.add_bodies(scene, rng, half * 0.8, int(rng.integers(1, 6)))
    count, spread = int(10 ** rng.uniform(0, 2.1)), rng.uniform(0.1, 0.8)
    size = rng.uniform(-1.9, -0.8)
    for _ in range(count):
        centre = rng.uniform(-0.9, 0.9, 3) * half + [0, half[1], 0]
        centre[2] = min(centre[2], 0.3 * half[2])
        radius = 10 ** (size + rng.normal(0, 0.2))
        stuff.add_bulb(scene, rng, centre, min(radius, 0.25), 30 * 10 ** rng.normal(0, spread) / count)
    sets.camera_inside(scene, rng, half, depth=int(rng.choice([2, 3, 4, 6, 8])))


def signs(scene: RandomScene, rng: Rng) -> None:
    """Screens and neon tubes in view, over a floor that may shine."""
    half = np.array([rng.uniform(2, 4), rng.uniform(1.3, 2), rng.uniform(2, 4)])
    sets.walls(scene, rng, half, left_out=(FRONT,), polished=0.1)
    for _ in range(rng.integers(1, 5)):
        x, y = rng.uniform(-0.7, 0.7) * half[0], rng.uniform(0.5, 1.6) * half[1]
        w, h, z = rng.uniform(0.2, 0.9), rng.uniform(0.15, 0.5), rng.uniform(-0.95, 0) * half[2]
        corners = np.array([[x - w, y - h, z], [x + w, y - h, z], [x + w, y + h, z], [x - w, y + h, z]])
        stuff.add_screen(scene, rng, corners, 10 ** rng.uniform(-0.3, 1.2))
    for _ in range(rng.integers(0, 9)):
        start = np.array([rng.uniform(-0.9, 0.9), rng.uniform(0.2, 1.9), rng.uniform(-0.9, 0.2)]) * half
        end = start + rng.normal(0, 1, 3) * [0.7, 0.4, 0.2]
        stuff.add_tube_lamp(scene, rng, start, end, 10 ** rng.uniform(-2, -1.3), 10 ** rng.uniform(-0.3, 0.9))
    parts.add_bodies(scene, rng, half * 0.8, int(rng.integers(1, 6)), stuff.anything)
    sets.camera_inside(scene, rng, half, depth=int(rng.choice([2, 3, 5, 8])))


def gallery(scene: RandomScene, rng: Rng) -> None:
    """A room whose walls and floor are images of all frequencies, with painted bodies."""
    half = sets.room_size(rng)
    for i, wall in enumerate(box(np.array([0, half[1], 0]), np.diag(half))):
        if i != FRONT or rng.random() < 0.5:
            lines = stuff.painted(scene, rng) if rng.random() < 0.7 else parts.wall_material(scene, rng)
            parts.add_quad(scene, rng, lines, wall, tiles=2 ** int(rng.integers(0, 4)))
    parts.add_bodies(scene, rng, half * 0.8, int(rng.integers(1, 7)), stuff.anything)
    parts.add_lamps(scene, rng, half, ceiling=2 * half[1])
    sets.camera_inside(scene, rng, half, depth=int(rng.choice([2, 3, 4, 6, 8])))


def colonnade(scene: RandomScene, rng: Rng) -> None:
    """Two rows of columns or pillars along a hall, and lamps between them."""
    half = np.array([rng.uniform(2, 3.5), rng.uniform(1.3, 2.2), rng.uniform(4, 9)])
    sets.walls(scene, rng, half, polished=0.1)
    radius, material = rng.uniform(0.08, 0.3), stuff.anything(scene, rng)
    x = rng.uniform(0.4, 0.75) * half[0]
    round_ones, count = rng.random() < 0.6, int(rng.integers(3, 9))
    for z in np.linspace(-0.85, 0.6, count) * half[2]:
        for side in (-x, x):
            foot = np.array([side, 0, z])
            if round_ones:
                stuff.add_mesh(scene, material, rod(foot, moved(foot, 0, 2 * half[1], 0), radius, sides=16))
            else:
                parts.add_box(scene, material, moved(foot, 0, half[1], 0), np.diag([radius, half[1], radius]))
    for z in np.linspace(-0.8, 0.5, int(rng.integers(1, count + 1))) * half[2]:
        if rng.random() < 0.6:
            centre = np.array([rng.uniform(-0.2, 0.2), 2 * half[1] - 0.1, z])
            parts.add_lamp(scene, rng, centre, centre - [0, 1, 0], [rng.uniform(0.05, 0.4)] * 2, 3 / count)
        else:
            centre = np.array([rng.choice([-0.9, 0.9]) * half[0], rng.uniform(0.5, 1.7) * half[1], z])
            stuff.add_bulb(scene, rng, centre, rng.uniform(0.04, 0.15), 40 / count)
    sets.camera_inside(scene, rng, half, depth=int(rng.choice([3, 4, 6, 8])))


def tunnel(scene: RandomScene, rng: Rng) -> None:
    """A bent corridor, lit by rings or from its far end: many bounces."""
    count, sides = int(rng.integers(8, 16)), int(rng.choice([4, 6, 12]))
    bend, material = rng.uniform(-0.5, 0.5), parts.wall_material(scene, rng)
    other = parts.wall_material(scene, rng)
    angle = (np.arange(sides + 1) + 0.5) * 2 * np.pi / sides
    middle = np.array([[bend * (0.25 * k) ** 2, 1.5, 3 - 1.2 * k] for k in range(count + 1)])
    rings = middle[:, None] + 1.5 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    power = rng.uniform(0.5, 3)
    shining = set(rng.choice(np.arange(2, count), int(rng.integers(1, 4)), replace=False).tolist())
    for k in range(count):
        for s in range(sides):
            corners = np.array([rings[k, s], rings[k, s + 1], rings[k + 1, s + 1], rings[k + 1, s]])
            if k in shining and s % max(1, sides // 4) == 0:
                corners = corners.mean(0) + (corners - corners.mean(0)) * [0.5, 0.5, 0.15] - [0, 0.02, 0]
                inwards = (middle[k] - corners.mean(0)) * 0.05
                scene.polygons(
                    scene.material(stuff.glow_lines(power * 8 * parts.colour(rng, 0.5))), [corners + inwards]
                )
                continue
            parts.add_quad(scene, rng, material if (k + s) % 2 else other, corners)
    end = middle[-1] + np.array([[-1.6, -1.6, 0], [1.6, -1.6, 0], [1.6, 1.6, 0], [-1.6, 1.6, 0]])
    bright = stuff.glow_lines(power * parts.colour(rng, 0.3)) if rng.random() < 0.5 else parts.matt(rng)
    scene.polygons(scene.material(bright), [end])
    parts.add_bodies(scene, rng, np.array([1.0, 1.0, 3.0]), int(rng.integers(0, 4)))
    position, target = np.array([0, 1.6, 3.2]), np.array([rng.uniform(-0.5, 0.5), 1.4, -2])
    scene.settings = parts.settings(rng, position, target, rng.uniform(50, 80), int(rng.choice([6, 8, 12])))


def shaded(scene: RandomScene, rng: Rng) -> None:
    """A room whose lamps are within shades: most light comes by a wall or the ceiling."""
    half = sets.room_size(rng)
    sets.walls(scene, rng, half)
    parts.add_bodies(scene, rng, half * 0.8, int(rng.integers(2, 7)))
    for _ in range(rng.integers(1, 4)):
        x, z = rng.uniform(-0.7, 0.7) * half[0], rng.uniform(-0.8, 0.1) * half[2]
        centre, size = np.array([x, rng.uniform(0.5, 1.5) * half[1], z]), rng.uniform(0.1, 0.3)
        opening = int(rng.integers(0, 6))
        shade = scene.material(parts.matt(rng))
        axes = turned(rng, 0.3) * size
        for i, side in enumerate(box(centre, axes)):
            if i != opening:
                scene.polygons(shade, [side])
        stuff.add_bulb(scene, rng, centre, size * rng.uniform(0.1, 0.5), 40)
    sets.camera_inside(scene, rng, half, depth=int(rng.choice([4, 6, 8, 12])))


def shelves(scene: RandomScene, rng: Rng) -> None:
    """Boards with many small bodies on them, lit from the front or by strips below the boards."""
    boards, width = int(rng.integers(2, 6)), rng.uniform(1.2, 2.2)
    wood, gap = stuff.painted(scene, rng) if rng.random() < 0.5 else parts.matt(rng), 3.0 / boards
    parts.add_quad(scene, rng, parts.wall_material(scene, rng), moved(sets.back_wall(), 0, -1, 3.4))
    strips = rng.random() < 0.5
    for k in range(boards + 1):
        parts.add_box(scene, wood, np.array([0, k * gap, 0]), np.diag([width, 0.03, 0.45]))
        if strips and k:
            start = np.array([-0.9 * width, k * gap - 0.06, 0.35])
            end = start * [-1, 1, 1]
            stuff.add_tube_lamp(scene, rng, start, end, 0.015, 10 ** rng.uniform(0.2, 0.8))
    for side in (-width, width):
        parts.add_box(scene, wood, np.array([side, 1.5, 0]), np.diag([0.03, 1.53, 0.45]))
    for k in range(boards):
        x = -width + 0.15
        while x < width - 0.15:
            size = rng.uniform(0.04, 0.4) * gap
            place = np.array([x + size / 2, k * gap + 0.03 + size, rng.uniform(-0.2, 0.25)])
            lines = stuff.anything(scene, rng)
            if rng.random() < 0.5:
                parts.add_box(scene, lines, place, np.diag([rng.uniform(0.02, 0.1), size, 0.2]))
            else:
                axes = np.array([size * rng.uniform(0.4, 1), size, size * 0.6])
                stuff.add_mesh(scene, lines, star(place, superquadric(rng.choice([1, 1.5, 2, 4, 8]), axes)))
            x += size * rng.uniform(0.8, 2.5) + 0.05
    if not strips or rng.random() < 0.5:
        centre = np.array([rng.uniform(-3, 3), rng.uniform(1, 5), rng.uniform(3, 5)])
        parts.add_lamp(scene, rng, centre, np.array([0, 1.5, 0]), [10 ** rng.uniform(-1, 0.1)] * 2, 3)
    position = np.array([rng.uniform(-1.5, 1.5), rng.uniform(1, 2.3), rng.uniform(3, 4.5)])
    scene.settings = parts.settings(
        rng, position, np.array([0, 1.5, 0]), rng.uniform(30, 50), int(rng.choice([2, 3, 5, 8]))
    )


def blinds(scene: RandomScene, rng: Rng) -> None:
    """A room behind slats: stripes of light from a lamp or a sun outside."""
    half = sets.room_size(rng)
    sets.walls(scene, rng, half, left_out=(0,))
    slat, count = scene.material(parts.wall_material(scene, rng)), int(rng.integers(6, 28))
    tilt = rng.uniform(-0.7, 0.7)
    for y in np.linspace(0.05, 1.95, count) * half[1]:
        w = half[1] / count * rng.uniform(0.75, 1.1)
        axes = np.array(
            [
                [np.cos(tilt) * w, np.sin(tilt) * w, 0],
                [-np.sin(tilt) * 0.01, np.cos(tilt) * 0.01, 0],
                [0, 0, half[2]],
            ]
        )
        scene.polygons(slat, box(np.array([half[0], y, 0]), axes), coordinates=[SQUARE] * 6)
    parts.add_bodies(scene, rng, half * 0.8, int(rng.integers(2, 7)), stuff.anything)
    sets.camera_inside(scene, rng, half, depth=int(rng.choice([3, 4, 6, 8])))
    if rng.random() < 0.5:
        scene.settings += stuff.sun(scene, rng)
    else:
        centre = np.array([half[0] + rng.uniform(2, 4), rng.uniform(1.5, 5), rng.uniform(-1, 1) * half[2]])
        parts.add_lamp(scene, rng, centre, np.array([0, 1, 0]), [rng.uniform(0.1, 0.8)] * 2, 12)


def vases(scene: RandomScene, rng: Rng) -> None:
    """Turned vessels of any material on a table before a wall."""
    parts.add_quad(
        scene,
        rng,
        stuff.painted(scene, rng),
        np.array([[-9, 0, 6], [9, 0, 6], [9, 0, -4], [-9, 0, -4]], float),
        4,
    )
    parts.add_quad(scene, rng, parts.wall_material(scene, rng), moved(sets.back_wall(), 0, 0, 1))
    for _ in range(rng.integers(2, 8)):
        height, belly = rng.uniform(0.4, 1.8), rng.uniform(0.15, 0.5)
        t = np.linspace(0, 1, 14)
        outside = belly * (0.55 + 0.45 * np.sin(rng.uniform(1, 3) * np.pi * t + rng.uniform(0, 3)))
        wall = rng.uniform(0.02, 0.05)
        outside = np.maximum(outside, 2.5 * wall)
        up = np.stack([outside, t * height], axis=-1)
        down = np.stack([outside - wall, np.maximum(t * height, 2 * wall)], axis=-1)[::-1]
        base = np.array([[wall, 2 * wall], [wall, 0.001]])
        profile = np.concatenate([up, down, base])
        place = np.array([rng.uniform(-2.2, 2.2), 0.002, rng.uniform(-2.2, 1.5)])
        lines = parts.glass(rng) if rng.random() < 0.25 else stuff.anything(scene, rng)
        stuff.add_mesh(scene, lines, lathe(place, profile))
    parts.add_lamps(scene, rng, np.array([3, 2, 3]), ceiling=rng.uniform(3, 6))
    sets.camera_around(scene, rng, depth=int(rng.choice([3, 4, 6, 8])))
    if rng.random() < 0.3:
        scene.settings += parts.glow(rng)
