"""Rarer materials and lamps, for kinds of scenes that need them."""

import numpy as np

from nst_train.random_scenes import images, parts
from nst_train.random_scenes.files import RandomScene, numbers
from nst_train.random_scenes.meshes import rod
from nst_train.random_scenes.parts import Rng
from nst_train.random_scenes.shapes import SQUARE, box, turned


def painted(scene: RandomScene, rng: Rng, size: int = 128) -> str:
    """An image of any frequency; for polygons that have texture coordinates."""
    gloss = "" if rng.random() < 0.7 else f"\nPr {numbers([rng.uniform(0.1, 0.6)])}"
    return f"Kd 1 1 1\nmap_Kd {scene.image('bmp', images.bmp(images.picture(rng, size)))}{gloss}"


def cloth(rng: Rng) -> str:
    """Disney's material with sheen, or with a clear coat, or brushed."""
    kind = rng.integers(3)
    if kind == 0:
        return f"{parts.matt(rng)}\nPr {numbers([rng.uniform(0.6, 1)])}\nPs {numbers([rng.uniform(0.3, 1)])}"
    if kind == 1:
        coat = numbers([rng.uniform(0.5, 1)])
        rough = f"Pr {numbers([rng.uniform(0.3, 0.9)])}\nPcr {numbers([0.3 * rng.random()])}"
        return f"{parts.matt(rng)}\nPc {coat}\n{rough}"
    along = numbers([rng.uniform(0.5, 1)])
    return f"{parts.matt(rng)}\nPr {numbers([rng.uniform(0.15, 0.5)])}\nPm 1\naniso {along}"


def bumpy(scene: RandomScene, rng: Rng) -> str:
    """Matt or glossy, with a bump map; for polygons that have texture coordinates."""
    lines = parts.matt(rng) if rng.random() < 0.5 else parts.glossy(rng)
    height = (
        images.fractal(rng, 128, rng.uniform(0.3, 1.2)) if rng.random() < 0.7 else images.writing(rng, 128)
    )
    name = scene.image("bmp", images.bmp(np.repeat(height[..., None], 3, axis=-1)))
    return f"{lines}\nbump -bm {numbers([10 ** rng.uniform(-2.3, -1)])} {name}"


def veil(scene: RandomScene, rng: Rng) -> str:
    """Matt, but a share of light goes straight on, everywhere or through the holes of an image."""
    if rng.random() < 0.5:
        return f"{parts.matt(rng)}\nd {numbers([rng.uniform(0.2, 0.8)])}"
    holes = images.fractal(rng, 64, rng.uniform(0.3, 1.2)) > rng.uniform(0.4, 0.6)
    name = scene.image("bmp", images.bmp(np.repeat(holes[..., None] * 1.0, 3, axis=-1)))
    return f"{parts.matt(rng)}\nmap_d {name}"


def anything(scene: RandomScene, rng: Rng) -> str:
    """Common materials mostly, and rare ones."""
    kind = rng.random()
    if kind < 0.6:
        return parts.any_material(scene, rng)
    if kind < 0.75:
        return painted(scene, rng)
    return bumpy(scene, rng) if kind < 0.85 else cloth(rng)


def glow_lines(radiance: np.ndarray) -> str:
    return f"Kd 0 0 0\nKe {numbers(radiance)}"


def add_bulb(scene: RandomScene, rng: Rng, centre: np.ndarray, radius: float, power: float) -> None:
    """A lamp that is seen from everywhere: a small cube, or a ball if it is large enough to tell."""
    lines = glow_lines(power / (4 * np.pi * radius**2) * parts.colour(rng, 0.7))
    if radius > 0.06:
        parts.add_ball(scene, lines, centre, radius)
    else:
        scene.polygons(scene.material(lines), box(centre, turned(rng, 1.0) * radius * 0.7))


def add_tube_lamp(
    scene: RandomScene, rng: Rng, start: np.ndarray, end: np.ndarray, radius: float, power: float
) -> None:
    """A rod that shines."""
    area = 2 * np.pi * radius * np.linalg.norm(end - start)
    polygons, _, _ = rod(start, end, radius)
    scene.polygons(scene.material(glow_lines(power / area * parts.colour(rng, 0.8))), polygons)


def add_screen(scene: RandomScene, rng: Rng, corners: np.ndarray, radiance: float) -> None:
    """A quad that shows an image by its own light."""
    name = scene.image("bmp", images.bmp(images.picture(rng)))
    lines = f"Kd 0 0 0\nKe {numbers([radiance] * 3)}\nmap_Ke {name}"
    scene.polygons(scene.material(lines), [corners], coordinates=[SQUARE])


def add_mesh(scene: RandomScene, lines: str, mesh) -> None:
    scene.polygons(scene.material(lines), *mesh)


def sun(scene: RandomScene, rng: Rng) -> str:
    """The table [environment]: a sky whose sun is a few texels, so that shadows are hard."""
    height, width = images.SKY_HEIGHT, 2 * images.SKY_HEIGHT
    radiance = np.empty((height, width, 3))
    radiance[: height // 2] = rng.uniform(0.05, 0.8) * (1 - rng.random(3) * [0.7, 0.4, 0])
    radiance[height // 2 :] = rng.uniform(0.01, 0.2)
    clouds = images.fractal(rng, width, rng.uniform(0.6, 1.4))[: height // 2, :, None]
    radiance[: height // 2] *= 1 + rng.uniform(0, 1.5) * clouds
    row, column, size = int(rng.integers(4, 28)), int(rng.integers(0, width - 2)), int(rng.integers(1, 3))
    weight = size * size * np.sin((row + 0.5) / height * np.pi)
    radiance[row : row + size, column : column + size] = (
        10 ** rng.uniform(3.2, 4.2) / weight * np.array([1, 0.92, 0.8])
    )
    return f'\n[environment]\nimage = "{scene.image("hdr", images.hdr(radiance))}"\n'
