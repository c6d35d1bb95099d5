"""Kinds of scenes, each apart from the others: whole branches can be held out of training.

The floor is at y = 0; rooms are about 3 high.
"""

from collections.abc import Callable

import numpy as np

from nst_train.random_scenes import bodies, indoors, outside, parts, sets, sparse
from nst_train.random_scenes.files import RandomScene
from nst_train.random_scenes.images import noise
from nst_train.random_scenes.parts import Rng
from nst_train.random_scenes.shapes import FRONT, box, floor, hills, turned


def room(scene: RandomScene, rng: Rng) -> None:
    """A closed room with bodies, few lamps, and the camera in it."""
    half = sets.room_size(rng)
    sets.walls(scene, rng, half)
    parts.add_bodies(scene, rng, half * 0.8, int(rng.integers(2, 8)))
    parts.add_lamps(scene, rng, half, ceiling=2 * half[1])
    sets.camera_inside(scene, rng, half, depth=int(rng.choice([2, 3, 4, 5, 6, 8])))


def stage(scene: RandomScene, rng: Rng) -> None:
    """A room without its front wall, seen from outside."""
    half = sets.room_size(rng)
    sets.walls(scene, rng, half, left_out=(FRONT,))
    parts.add_bodies(scene, rng, half * 0.8, int(rng.integers(1, 6)))
    parts.add_lamps(scene, rng, half, ceiling=2 * half[1])
    position = np.array([rng.uniform(-0.3, 0.3), half[1], half[2] + rng.uniform(1.5, 2.2) * half[1]])
    depth = int(rng.choice([2, 3, 4, 5, 6, 8]))
    scene.settings = parts.settings(rng, position, np.array([0, half[1], 0]), rng.uniform(42, 62), depth)


def table(scene: RandomScene, rng: Rng) -> None:
    """Bodies on a large floor under lamps, perhaps before a wall."""
    parts.add_quad(scene, rng, parts.wall_material(scene, rng), floor(30), tiles=15)
    if rng.random() < 0.4:
        parts.add_quad(scene, rng, parts.matt(rng), sets.back_wall())
    half = np.array([2.5, 1.5, 2.5])
    parts.add_bodies(scene, rng, half, int(rng.integers(1, 9)))
    parts.add_lamps(scene, rng, half * 1.6, ceiling=rng.uniform(3, 8))
    sets.camera_around(scene, rng, depth=int(rng.choice([2, 2, 3, 4, 6])))
    if rng.random() < 0.4:
        scene.settings += parts.glow(rng)


def outdoors(scene: RandomScene, rng: Rng) -> None:
    """Bodies on a floor under a sky."""
    parts.add_quad(scene, rng, parts.wall_material(scene, rng), floor(30), tiles=15)
    parts.add_bodies(scene, rng, np.array([2.5, 1.5, 2.5]), int(rng.integers(2, 9)))
    sets.camera_around(scene, rng, depth=int(rng.choice([2, 3, 4, 6, 8])))
    scene.settings += parts.sky(scene, rng)


def plane(scene: RandomScene, rng: Rng) -> None:
    """A bare floor, seen from above or aslant, and one or two lamps near it."""
    lines = parts.matt(rng) if rng.random() < 0.5 else parts.glossy(rng)
    parts.add_quad(scene, rng, lines, floor(20))
    for _ in range(rng.integers(1, 3)):
        centre = np.array([rng.uniform(-1.5, 1.5), rng.uniform(0.5, 3), rng.uniform(-1.5, 1.5)])
        sides = [10 ** rng.uniform(-0.7, 0.4), 10 ** rng.uniform(-1.5, 0.2)]
        parts.add_lamp(scene, rng, centre, centre - [rng.uniform(-1, 1), 2, rng.uniform(-1, 1)], sides)
    position = np.array([rng.uniform(-2, 2), rng.uniform(1, 5), rng.uniform(0.1, 4)])
    target = np.array([rng.uniform(-0.5, 0.5), 0, rng.uniform(-0.5, 0.5)])
    depth = int(rng.choice([2, 2, 3]))
    scene.settings = parts.settings(rng, position, target, rng.uniform(40, 105), depth)


def thicket(scene: RandomScene, rng: Rng) -> None:
    """Thin sticks and leaves, hundreds of them, under a lamp or a sky."""
    parts.add_quad(scene, rng, parts.wall_material(scene, rng), floor(30), tiles=15)
    for _ in range(rng.integers(2, 5)):
        material = scene.material(parts.matt(rng) if rng.random() < 0.7 else parts.glossy(rng))
        width = 10 ** rng.uniform(-2, -1.2)
        for _ in range(rng.integers(20, 60)):
            extents = np.array([width, rng.uniform(0.2, 1.2), width * rng.choice([1, 6])])
            place = np.array([rng.uniform(-2, 2), rng.uniform(0, 1.5), rng.uniform(-2, 1)])
            scene.polygons(material, box(place, turned(rng, tumbling=0.6) * extents[:, None]))
    sets.camera_around(scene, rng, depth=int(rng.choice([2, 3, 4, 6])))
    if rng.random() < 0.5:
        scene.settings += parts.sky(scene, rng)
    else:
        parts.add_lamps(scene, rng, np.array([3, 2, 3]), ceiling=rng.uniform(3, 6))


def glass(scene: RandomScene, rng: Rng) -> None:
    """Glass before small lamps, seen by long paths: caustics."""
    parts.add_quad(scene, rng, parts.wall_material(scene, rng), floor(30), tiles=15)
    if rng.random() < 0.5:
        parts.add_quad(scene, rng, parts.matt(rng), sets.back_wall())

    def mostly_glass(scene: RandomScene, rng: Rng) -> str:
        return parts.glass(rng) if rng.random() < 0.65 else parts.any_material(scene, rng)

    parts.add_bodies(scene, rng, np.array([2.0, 1.5, 2.0]), int(rng.integers(2, 7)), mostly_glass)
    for _ in range(rng.integers(1, 4)):
        centre = np.array([rng.uniform(-3, 3), rng.uniform(3, 6), rng.uniform(-2, 3)])
        parts.add_lamp(scene, rng, centre, np.zeros(3), [10 ** rng.uniform(-1, 0)] * 2)
    sets.camera_around(scene, rng, depth=int(rng.choice([4, 6, 8, 12])))
    if rng.random() < 0.5:
        scene.settings += parts.glow(rng)


def hall(scene: RandomScene, rng: Rng) -> None:
    """A long room with tens of lamps of all colours and sizes."""
    half = np.array([rng.uniform(2, 4), rng.uniform(1.2, 2.5), rng.uniform(4, 8)])
    sets.walls(scene, rng, half)
    parts.add_bodies(scene, rng, half * 0.8, int(rng.integers(3, 12)))
    parts.add_lamps(scene, rng, half, ceiling=2 * half[1], count=int(10 ** rng.uniform(1, 2)))
    sets.camera_inside(scene, rng, half, depth=int(rng.choice([2, 3, 4, 6])))


def mirrors(scene: RandomScene, rng: Rng) -> None:
    """Metals and mirrors that light each other, in a room or under a sky."""

    def mostly_metal(scene: RandomScene, rng: Rng) -> str:
        return parts.mirror(rng) if rng.random() < 0.6 else parts.glossy(rng)

    depth = int(rng.choice([4, 6, 8, 12]))
    if rng.random() < 0.6:
        half = sets.room_size(rng)
        sets.walls(scene, rng, half, polished=0.3)
        parts.add_bodies(scene, rng, half * 0.8, int(rng.integers(2, 7)), mostly_metal)
        parts.add_lamps(scene, rng, half, ceiling=2 * half[1])
        sets.camera_inside(scene, rng, half, depth)
    else:
        parts.add_quad(scene, rng, parts.wall_material(scene, rng), floor(30), tiles=15)
        parts.add_bodies(scene, rng, np.array([2.5, 1.5, 2.5]), int(rng.integers(2, 9)), mostly_metal)
        sets.camera_around(scene, rng, depth)
        scene.settings += parts.sky(scene, rng)


def maze(scene: RandomScene, rng: Rng) -> None:
    """A room parted by walls that do not reach the sides: what the camera sees is lit around corners."""
    half = sets.room_size(rng)
    sets.walls(scene, rng, half)
    for z in np.linspace(-0.35, 0.25, int(rng.integers(1, 3))) * half[2]:
        gap = rng.uniform(0.3, 0.8) * half[0]
        height = rng.uniform(0.75, 1) * half[1]
        centre = np.array([gap / 2 * rng.choice([-1, 1]), height, z])
        extents = np.diag([half[0] - gap / 2, height, 0.05])
        parts.add_box(scene, parts.wall_material(scene, rng), centre, extents)
    parts.add_bodies(scene, rng, half * 0.8, int(rng.integers(1, 5)))
    far = np.array([rng.uniform(-0.6, 0.6) * half[0], rng.uniform(1.2, 1.9) * half[1], -0.7 * half[2]])
    target = np.array([rng.uniform(-1, 1) * half[0], rng.uniform(0, 1) * half[1], -half[2]])
    parts.add_lamp(scene, rng, far, target, [rng.uniform(0.1, 0.5)] * 2, power=3)
    sets.camera_inside(scene, rng, half, depth=int(rng.choice([4, 6, 8, 12])))


def window(scene: RandomScene, rng: Rng) -> None:
    """A room that a sky lights through one opening."""
    half = sets.room_size(rng)
    side = 0 if rng.random() < 0.5 else 1  # of `box`: +x or −x
    sets.walls(scene, rng, half, left_out=(side,))
    x = half[0] * (1 - 2 * side)
    width, sill = rng.uniform(0.3, 0.8), rng.uniform(0, 0.5)
    lines = parts.matt(rng)
    for low, high, begin, end in (
        (0, sill, -1, 1),
        (sill + rng.uniform(0.3, 0.5) * (2 - sill), 2, -1, 1),
        (0, 2, -1, -width),
        (0, 2, width, 1),
    ):
        y, z = np.array([low, low, high, high]) * half[1], np.array([begin, end, end, begin]) * half[2]
        parts.add_quad(scene, rng, lines, np.stack([np.full(4, x), y, z], axis=-1))
    parts.add_bodies(scene, rng, half * 0.7, int(rng.integers(1, 6)))
    sets.camera_inside(scene, rng, half, depth=int(rng.choice([3, 4, 6, 8])))
    scene.settings += parts.sky(scene, rng)


def landscape(scene: RandomScene, rng: Rng) -> None:
    """Hills with an image on them, and bodies half in the ground, under a sky."""
    heights = rng.uniform(0.3, 2) * noise(rng, 33, 33, 4)
    polygons, normals, coordinates = hills(heights, 8)
    scene.polygons(scene.material(parts.textured(scene, rng)), polygons, normals, coordinates)
    for _ in range(rng.integers(2, 10)):
        centre = np.array([rng.uniform(-4, 4), rng.uniform(0.3, 1.5), rng.uniform(-4, 2)])
        radius = 10 ** rng.uniform(-0.8, 0)
        if rng.random() < 0.5:
            parts.add_ball(scene, parts.any_material(scene, rng), centre, radius)
        else:
            parts.add_box(scene, parts.any_material(scene, rng), centre, turned(rng, 0.7) * radius * 0.7)
    position = np.array([rng.uniform(-2, 2), rng.uniform(2.5, 6), rng.uniform(6, 9)])
    depth = int(rng.choice([2, 3, 4, 6]))
    scene.settings = parts.settings(rng, position, np.array([0, 0.8, 0]), rng.uniform(30, 60), depth)
    scene.settings += parts.sky(scene, rng)


BRANCHES: dict[str, Callable[[RandomScene, Rng], None]] = {
    branch.__name__: branch
    for branch in (
        *(room, stage, table, outdoors, plane, thicket),
        *(glass, hall, mirrors, maze, window, landscape),
        *(indoors.lanterns, indoors.signs, indoors.gallery, indoors.colonnade, indoors.tunnel),
        *(indoors.shaded, indoors.shelves, indoors.blinds, indoors.vases),
        *(outside.city, outside.terraces, outside.foliage, outside.fence, outside.backlight),
        *(outside.night, outside.water),
        *(
            bodies.knots,
            bodies.blobs,
            bodies.drapes,
            bodies.jewels,
            bodies.panes,
            bodies.macro,
            bodies.studio,
        ),
        *(sparse.dust, sparse.sparks, sparse.wires),
    )
}
