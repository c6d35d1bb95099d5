"""What branches are made of: materials, lamps, skies, bodies, and cameras."""

import numpy as np

from nst_train.random_scenes import images
from nst_train.random_scenes.files import RandomScene, numbers
from nst_train.random_scenes.shapes import SQUARE, ball, box, turned

Rng = np.random.Generator


def colour(rng: Rng, saturation: float) -> np.ndarray:
    """A colour whose largest component is 1; grey in three cases of ten."""
    if rng.random() < 0.3:
        return np.ones(3)
    drawn = 1 - saturation * rng.random(3)
    return drawn / drawn.max()


def reflectance(rng: Rng) -> np.ndarray:
    return colour(rng, 0.6) * rng.uniform(0.15, 0.85)


def matt(rng: Rng) -> str:
    return f"Kd {numbers(reflectance(rng))}"


def glossy(rng: Rng) -> str:
    """Disney's material, from smooth to nearly matt, dielectric or metallic."""
    metallic = 0.0 if rng.random() < 0.4 else rng.uniform(0.1, 1)
    return f"{matt(rng)}\nPr {numbers([rng.uniform(0.08, 0.7)])}\nPm {numbers([metallic])}"


def mirror(rng: Rng) -> str:
    """A metal, nearly or quite a mirror."""
    kd = numbers(colour(rng, 0.4) * rng.uniform(0.7, 0.95))
    return f"Kd {kd}\nPr {numbers([rng.choice([0.02, 0.05, 0.1])])}\nPm 1"


def glass(rng: Rng) -> str:
    return f"Kd 0 0 0\nKs 1 1 1\nNi {numbers([rng.uniform(1.2, 1.8)])}\nd 0\nillum 7"


def textured(scene: RandomScene, rng: Rng) -> str:
    """Matt or glossy, with an image; for polygons that have texture coordinates."""
    content = images.bmp(images.texture(rng, reflectance(rng) ** 0.5, reflectance(rng) ** 0.5))
    gloss = "" if rng.random() < 0.6 else f"\nPr {numbers([rng.uniform(0.1, 0.6)])}"
    return f"Kd 1 1 1\nmap_Kd {scene.image('bmp', content)}{gloss}"


def any_material(scene: RandomScene, rng: Rng) -> str:
    """Of all kinds, by how common they are."""
    kind = rng.random()
    if kind < 0.4:
        return matt(rng)
    if kind < 0.55:
        return textured(scene, rng)
    if kind < 0.85:
        return glossy(rng)
    return mirror(rng) if kind < 0.92 else glass(rng)


def wall_material(scene: RandomScene, rng: Rng) -> str:
    """Mostly matt."""
    kind = rng.random()
    if kind < 0.7:
        return matt(rng)
    return textured(scene, rng) if kind < 0.88 else glossy(rng)


def add_quad(scene: RandomScene, rng: Rng, lines: str, corners: np.ndarray, tiles: float = 1.0) -> None:
    """A quad whose image repeats `tiles` times along each side."""
    scene.polygons(scene.material(lines), [corners], coordinates=[SQUARE * tiles])


def add_ball(scene: RandomScene, lines: str, centre: np.ndarray, radius: float) -> None:
    polygons, normals, coordinates = ball(centre, radius)
    scene.polygons(scene.material(lines), polygons, normals, coordinates)


def add_box(scene: RandomScene, lines: str, centre: np.ndarray, axes: np.ndarray) -> None:
    scene.polygons(scene.material(lines), box(centre, axes), coordinates=[SQUARE] * 6)


def add_bodies(scene: RandomScene, rng: Rng, half: np.ndarray, count: int, material=any_material) -> None:
    """Balls and boxes that stand on the floor, or float above it, within ±`half` of the y axis."""
    for _ in range(count):
        size = 10 ** rng.uniform(-0.7, 0.05) * half[1] / 1.5
        x, z = rng.uniform(-1, 1) * (half[0] - size), rng.uniform(-1, 0.4) * (half[2] - size)
        height = 0.0 if rng.random() < 0.75 else rng.uniform(0, half[1])
        lines = material(scene, rng)
        if rng.random() < 0.5:
            add_ball(scene, lines, np.array([x, height + size, z]), size * 0.9)
        else:
            extents = size * rng.uniform(0.4, 1.0, 3)
            axes = turned(rng) * extents[:, None]
            add_box(scene, lines, np.array([x, height + np.abs(axes[:, 1]).sum(), z]), axes)


def add_lamp(
    scene: RandomScene,
    rng: Rng,
    centre: np.ndarray,
    target: np.ndarray,
    sides: list[float],
    power: float = 1.0,
) -> None:
    """A rectangle of half sides `sides` that faces `target`; the smaller, the brighter."""
    forward = target - centre
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, rng.normal(size=3))
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    u, v = sides[0] * right, sides[1] * up
    radiance = 12 * power / (4 * sides[0] * sides[1]) * colour(rng, 0.3)
    corners = np.array([centre - u - v, centre + u - v, centre + u + v, centre - u + v])
    scene.polygons(scene.material(f"Kd 0 0 0\nKe {numbers(radiance)}"), [corners])


def add_lamps(
    scene: RandomScene, rng: Rng, half: np.ndarray, ceiling: float, count: int | None = None
) -> None:
    """Rectangles of all sizes, most of them below the ceiling; without a `count`, few."""
    if count is None:
        count = int(rng.choice([1, 2, 3, 6], p=(0.5, 0.25, 0.15, 0.1)))
    largest = 0.35 * min(half[0], half[2])
    for _ in range(count):
        if rng.random() < 0.75:
            x, z = rng.uniform(-0.7, 0.7) * half[0], rng.uniform(-0.7, 0.5) * half[2]
            centre = np.array([x, ceiling - rng.uniform(0.02, 0.3), z])
            target = centre - [rng.uniform(-0.3, 0.3), 1, rng.uniform(-0.3, 0.3)]
        else:
            centre = rng.uniform(-0.85, 0.85, 3) * half + [0, half[1], 0]
            target = np.array([0, 0.5, 0]) + rng.uniform(-0.5, 0.5, 3)
        long = largest * 10 ** rng.uniform(-1.5, 0)
        broad = long if rng.random() < 0.6 else long * 10 ** rng.uniform(-1.2, 0)
        add_lamp(scene, rng, centre, target, [long, broad], power=10 ** rng.normal(0, 0.4) / count)


def sky(scene: RandomScene, rng: Rng) -> str:
    """The table [environment]: an image of a sky, or the renderer's."""
    if rng.random() < 0.2:
        return '\n[environment]\nlight = "sky"\n'
    return f'\n[environment]\nimage = "{scene.image("hdr", images.hdr(images.sky(rng)))}"\n'


def glow(rng: Rng) -> str:
    """The table [environment]: the same dim radiance from everywhere."""
    return f"\n[environment]\nradiance = [{numbers(10 ** rng.uniform(-2, 0) * colour(rng, 0.6), ', ')}]\n"


def settings(rng: Rng, position: np.ndarray, target: np.ndarray, fov: float, depth: int) -> str:
    """The tables [camera] and [integrator]."""
    roulette = "true" if rng.random() < 0.8 else "false"
    return (
        f"[camera]\nposition = [{numbers(position, ', ')}]\ntarget = [{numbers(target, ', ')}]\n"
        f"vertical_fov = {fov:.4f}\n\n[integrator]\nmax_depth = {depth}\nrussian_roulette = {roulette}\n"
    )
