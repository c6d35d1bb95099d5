"""Meshes of formulas: bodies that are stars around a centre, turned on a lathe, tubes, sheets, and rods.

Each returns polygons, normals and texture coordinates, as `RandomScene.polygons` takes them.
"""

from collections.abc import Callable

import numpy as np

from nst_train.random_scenes.files import Points
from nst_train.random_scenes.shapes import ball

Mesh = tuple[list[Points], list[Points], list[np.ndarray]]
STEP = 1e-4
"""Of the differences that normals are made of."""


def star(centre: np.ndarray, radius: Callable[[np.ndarray], np.ndarray]) -> Mesh:
    """A closed body whose surface is `radius(n)` away from its centre in each direction n, `[…, xyz]`."""
    directions, _, coordinates = ball(np.zeros(3), 1.0)
    polygons, normals = [], []
    for n in directions:
        a = np.cross(n, np.eye(3)[np.abs(n).argmin(-1)])
        a /= np.linalg.norm(a, axis=-1, keepdims=True)
        b = np.cross(n, a)
        r = radius(n)[:, None]

        def slope(along: np.ndarray, n: np.ndarray = n) -> np.ndarray:
            beside = [
                x / np.linalg.norm(x, axis=-1, keepdims=True) for x in (n + STEP * along, n - STEP * along)
            ]
            return (radius(beside[0]) - radius(beside[1]))[:, None] / (2 * STEP)

        normal = r * n - slope(a) * a - slope(b) * b
        polygons.append(centre + r * n)
        normals.append(normal / np.linalg.norm(normal, axis=-1, keepdims=True))
    return polygons, normals, coordinates


def superquadric(power: float, axes: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """For `star`: a ball if `power` is 2, nearly a box if it is large, an octahedron if it is 1."""
    return lambda n: (np.abs(n / axes) ** power).sum(-1) ** (-1 / power)


def bumps(
    rng: np.random.Generator, size: float, count: int, height: float
) -> Callable[[np.ndarray], np.ndarray]:
    """For `star`: a ball with smooth bumps and dents."""
    places = rng.normal(size=(count, 3))
    places /= np.linalg.norm(places, axis=-1, keepdims=True)
    heights = rng.uniform(-1, 1, count) * height
    sharpness = 10 ** rng.uniform(0.3, 1.2, count)
    return lambda n: size * np.exp((heights * np.exp(sharpness * (n @ places.T - 1))).sum(-1))


def surface(points: np.ndarray, around: bool, along: bool) -> Mesh:
    """Smooth quads between points `[row, column, xyz]`; columns close if `around`, rows if `along`.

    They wind so that ∂row × ∂column points outwards.
    """
    rows, columns, _ = points.shape

    def derivative(axis: int, closed: bool) -> np.ndarray:
        if closed:
            return np.roll(points, -1, axis) - np.roll(points, 1, axis)
        return np.gradient(points, axis=axis)

    normals = np.cross(derivative(0, along), derivative(1, around))
    normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-12)
    found: Mesh = ([], [], [])
    for i in range(rows if along else rows - 1):
        for j in range(columns if around else columns - 1):
            corners = [(i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)]
            found[0].append(np.array([points[k % rows, m % columns] for k, m in corners]))
            found[1].append(np.array([normals[k % rows, m % columns] for k, m in corners]))
            found[2].append(np.array([[m / columns, k / rows] for k, m in corners]))
    return found


def lathe(centre: np.ndarray, profile: np.ndarray, segments: int = 32) -> Mesh:
    """A closed profile `[point, (radius, height)]`, counterclockwise, turned about the y axis at `centre`."""
    angle = np.arange(segments) * 2 * np.pi / segments
    r, y = profile[:, :1], np.broadcast_to(profile[:, 1:], (len(profile), segments))
    points = np.stack([r * np.sin(angle), y, r * np.cos(angle)], axis=-1) + centre
    return surface(points[::-1], around=True, along=True)


def tube(curve: np.ndarray, radius: float, sides: int = 10) -> Mesh:
    """A closed curve `[point, xyz]` as a tube."""
    tangent = np.roll(curve, -1, 0) - np.roll(curve, 1, 0)
    tangent /= np.linalg.norm(tangent, axis=-1, keepdims=True)
    bend = np.roll(tangent, -1, 0) - np.roll(tangent, 1, 0)
    a = bend - (bend * tangent).sum(-1, keepdims=True) * tangent
    a /= np.linalg.norm(a, axis=-1, keepdims=True)
    b = np.cross(tangent, a)
    angle = np.arange(sides)[:, None] * 2 * np.pi / sides
    points = curve[:, None] + radius * (np.cos(angle) * a[:, None] - np.sin(angle) * b[:, None])
    return surface(points, around=True, along=True)


def knot(rng: np.random.Generator, centre: np.ndarray, size: float) -> Mesh:
    """A ring, or a knot on a torus."""
    windings, turns = [(1, 0), (2, 3), (3, 2), (2, 5), (3, 4)][rng.integers(5)]
    t = np.linspace(0, 2 * np.pi, 96 if turns else 40, endpoint=False)
    r = 1 + 0.4 * np.cos(turns * t)
    curve = np.stack([r * np.cos(windings * t), 0.4 * np.sin(turns * t), r * np.sin(windings * t)], axis=-1)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return tube(centre + size / 1.4 * curve @ turn.T, size * rng.uniform(0.07, 0.2))


def rod(start: np.ndarray, end: np.ndarray, radius: float, sides: int = 6) -> Mesh:
    """A cylinder without caps."""
    along = (end - start) / np.linalg.norm(end - start)
    a = np.cross(along, np.eye(3)[np.abs(along).argmin()])
    a /= np.linalg.norm(a)
    angle = np.arange(sides)[:, None] * 2 * np.pi / sides
    ring = radius * (np.cos(angle) * a - np.sin(angle) * np.cross(along, a))
    return surface(np.stack([start + ring, end + ring]), around=True, along=False)
