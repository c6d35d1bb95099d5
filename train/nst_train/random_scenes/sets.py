"""Rooms, and where the camera stands in them or before them."""

import numpy as np

from nst_train.random_scenes import parts
from nst_train.random_scenes.files import RandomScene
from nst_train.random_scenes.parts import Rng
from nst_train.random_scenes.shapes import box


def room_size(rng: Rng) -> np.ndarray:
    """Half its width, height and depth."""
    return np.array([rng.uniform(1.5, 4), rng.uniform(1.2, 2), rng.uniform(1.5, 4)])


def walls(
    scene: RandomScene, rng: Rng, half: np.ndarray, left_out: tuple[int, ...] = (), polished: float = 0.0
) -> None:
    """The sides of a room but some; a share of them is polished."""
    for i, wall in enumerate(box(np.array([0, half[1], 0]), np.diag(half))):
        if i not in left_out:
            lines = parts.mirror(rng) if rng.random() < polished else parts.wall_material(scene, rng)
            parts.add_quad(scene, rng, lines, wall, tiles=4)


def back_wall() -> np.ndarray:
    return np.array([[-30, 0, -4], [30, 0, -4], [30, 12, -4], [-30, 12, -4]], float)


def camera_inside(scene: RandomScene, rng: Rng, half: np.ndarray, depth: int) -> None:
    """Near the front wall, towards the back."""
    position = np.array([rng.uniform(-0.7, 0.7), rng.uniform(0.6, 1.7), rng.uniform(0.6, 0.9)]) * half
    target = np.array([rng.uniform(-0.4, 0.4) * half[0], rng.uniform(0.3, 0.9) * half[1], -0.5 * half[2]])
    scene.settings = parts.settings(rng, position, target, rng.uniform(50, 95), depth)


def camera_around(scene: RandomScene, rng: Rng, depth: int) -> None:
    """In front of the y axis, some metres away, a little to the side."""
    angle, distance = rng.uniform(-0.8, 0.8), rng.uniform(3.5, 7.5)
    position = np.array(
        [distance * np.sin(angle), rng.uniform(0.1, 0.7) * distance, distance * np.cos(angle)]
    )
    target = np.array([rng.uniform(-0.5, 0.5), rng.uniform(0.3, 1.2), 0])
    scene.settings = parts.settings(rng, position, target, rng.uniform(28, 60), depth)
