"""Polygons of simple bodies, counterclockwise from outside."""

import numpy as np

from nst_train.random_scenes.files import Points

SEGMENTS = 24
FRONT = 4
"""The side of `box` that the third axis points to."""

SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
"""Texture coordinates of a quad."""


def box(centre: np.ndarray, axes: np.ndarray) -> list[Points]:
    """The six sides of a box from its half edges, the right-handed rows of `axes`."""
    sides = []
    for i in range(3):
        w, u, v = axes[i], axes[i - 2], axes[i - 1]
        for sign in (1, -1):
            middle = centre + sign * w
            corners = [middle - u - v, middle + u - v, middle + u + v, middle - u + v]
            sides.append(np.array(corners[::sign]))
    return sides


def ball(centre: np.ndarray, radius: float) -> tuple[list[Points], list[Points], list[np.ndarray]]:
    """Quads between meridians and triangles at the poles; their normals and texture coordinates."""
    around = np.linspace(0, 2 * np.pi, SEGMENTS + 1)
    down = np.linspace(0, np.pi, SEGMENTS // 2 + 1)

    def normal(i: int, j: int) -> list[float]:
        theta, phi = down[i], around[j % SEGMENTS]
        return [np.sin(theta) * np.cos(phi), np.cos(theta), np.sin(theta) * np.sin(phi)]

    normals, coordinates = [], []
    for i in range(len(down) - 1):
        for j in range(SEGMENTS):
            places = [(i, j), (i, j + 1), (i + 1, j + 1), (i + 1, j)]
            if i == 0:
                places.pop(0)
            elif i == len(down) - 2:
                places.pop(2)
            normals.append(np.array([normal(*place) for place in places]))
            coordinates.append(np.array([[j / SEGMENTS, 2 * i / SEGMENTS] for i, j in places]))
    return [centre + radius * n for n in normals], normals, coordinates


def floor(size: float) -> Points:
    """A square at y = 0, of half side `size`, that looks up."""
    return size * np.array([[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]], float)


def hills(heights: np.ndarray, size: float) -> tuple[list[Points], list[Points], list[np.ndarray]]:
    """Smooth quads over a square of half side `size`, from heights `[z, x]` on a grid."""
    count = len(heights)
    step = 2 * size / (count - 1)
    z, x = np.mgrid[:count, :count] * step - size
    points = np.stack([x, heights, z], axis=-1)
    slope_z, slope_x = np.gradient(heights, step)
    normals = np.stack([-slope_x, np.ones_like(heights), -slope_z], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    corners = [
        [(j + 1, i), (j + 1, i + 1), (j, i + 1), (j, i)] for j in range(count - 1) for i in range(count - 1)
    ]

    def pick(table: np.ndarray) -> list[np.ndarray]:
        return [np.array([table[place] for place in quad]) for quad in corners]

    return pick(points), pick(normals), pick(points[..., [0, 2]] / 4)


def moved(points: np.ndarray, x: float, y: float, z: float) -> np.ndarray:
    """One point or several, moved."""
    return points + np.array([x, y, z])


def turned(rng: np.random.Generator, tumbling: float = 0.2) -> np.ndarray:
    """Three axes, turned about y, and sometimes about any axis; rows are the axes."""
    if rng.random() < tumbling:
        q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        return q * np.linalg.det(q)  # right-handed
    angle = rng.uniform(0, np.pi / 2)
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])
