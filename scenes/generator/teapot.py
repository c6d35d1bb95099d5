"""The Utah teapot: Martin Newell's 32 Bézier patches (1975), with lid, handle, spout and bottom.

The numbers are those of `examples/jsm/geometries/TeapotGeometry.js` in the npm package three 0.187.0,
where they stand as 290 control points. Here they are folded by the teapot's symmetries: body and lid
are nearly surfaces of revolution, four patches around; handle and spout are tubes, two patches around.
The heights are the usual ones, which are 1/1.3 of Newell's own. As in the original, there is a small
gap between lid and rim, the spout is open, and handle and spout run into the body.
"""

from collections.abc import Iterator, Sequence

from generator.mesh import Corner, Face, Vec3, add, cross, length, normalize, scale

Patch = list[list[Vec3]]
"""4 × 4 control points; the first index belongs to u, the second to v. ∂u × ∂v points outwards."""

BODY = (
    # Distance from the axis, length of the tangent around it, height: from the rim's inside, over
    # the rim, down the outside, to the middle of the bottom.
    (1.4, 0.784, 2.4),
    (1.3375, 0.749, 2.53125),
    (1.4375, 0.805, 2.53125),
    (1.5, 0.84, 2.4),
    (1.75, 0.98, 1.875),
    (2.0, 1.12, 1.35),
    (2.0, 1.12, 0.9),
    (2.0, 1.12, 0.45),
    (1.5, 0.84, 0.225),
    (1.5, 0.84, 0.15),
    (1.5, 0.84, 0.075),
    (1.425, 0.798, 0.0),
    (0.0, 0.0, 0.0),
)

LID = (
    # The same, from the top of the knob to the edge.
    (0.0, 0.0, 3.15),
    (0.8, 0.45, 3.15),
    (0.0, 0.0, 2.85),
    (0.2, 0.112, 2.7),
    (0.4, 0.224, 2.55),
    (1.3, 0.728, 2.55),
    (1.3, 0.728, 2.4),
)

HANDLE = (
    # x and height of the inner side, x and height of the outer side, half the width.
    (-1.6, 2.025, -1.5, 2.25, 0.3),
    (-2.3, 2.025, -2.5, 2.25, 0.3),
    (-2.7, 2.025, -3.0, 2.25, 0.3),
    (-2.7, 1.8, -3.0, 1.8, 0.3),
    (-2.7, 1.575, -3.0, 1.35, 0.3),
    (-2.5, 1.125, -2.65, 0.9375, 0.3),
    (-2.0, 0.9, -1.9, 0.6, 0.3),
)

SPOUT = (
    # The same, from the body to the tip; the inner side is the upper one.
    (1.7, 1.425, 1.7, 0.6, 0.66),
    (2.6, 1.425, 3.1, 0.825, 0.66),
    (2.3, 2.1, 2.4, 2.025, 0.25),
    (2.7, 2.4, 3.3, 2.4, 0.25),
    (2.8, 2.475, 3.525, 2.49375, 0.25),
    (2.9, 2.475, 3.45, 2.5125, 0.15),
    (2.8, 2.4, 3.2, 2.4, 0.15),
)


def patches() -> Iterator[Patch]:
    """The 32 patches. Newell's axes: z points up, the spout along x."""
    for profile in (BODY, LID):
        for first in range(0, len(profile) - 1, 3):
            rows = profile[first : first + 4]
            for cos, sin in ((1, 0), (0, 1), (-1, 0), (0, -1)):
                quarter = [[(r, 0.0), (r, t), (t, r), (0.0, r)] for r, t, _ in rows]
                yield [
                    [(x * cos - y * sin, x * sin + y * cos, height) for x, y in ring]
                    for ring, (_, _, height) in zip(quarter, rows, strict=True)
                ]
    for tube in (HANDLE, SPOUT):
        for first in (0, 3):
            rows = tube[first : first + 4]
            yield [[(ox, 0.0, oz), (ox, -w, oz), (ix, -w, iz), (ix, 0.0, iz)] for ix, iz, ox, oz, w in rows]
            yield [[(ix, 0.0, iz), (ix, w, iz), (ox, w, oz), (ox, 0.0, oz)] for ix, iz, ox, oz, w in rows]


def _bernstein(t: float) -> tuple[float, ...]:
    s = 1 - t
    return (s * s * s, 3 * s * s * t, 3 * s * t * t, t * t * t)


def _bernstein_derivative(t: float) -> tuple[float, ...]:
    s = 1 - t
    return (-3 * s * s, 3 * s * (s - 2 * t), 3 * t * (2 * s - t), 3 * t * t)


def _combine(patch: Patch, u: Sequence[float], v: Sequence[float]) -> Vec3:
    """The sum of u_i v_j P_ij."""
    total = (0.0, 0.0, 0.0)
    for row, weight_u in zip(patch, u, strict=True):
        for point, weight_v in zip(row, v, strict=True):
            total = add(total, scale(point, weight_u * weight_v))
    return total


def evaluate(patch: Patch, u: float, v: float) -> tuple[Vec3, Vec3]:
    """A point of a patch, and the unit normal there.

    At a pole ∂v vanishes: all v are one point. It vanishes there like (u − pole) ∂u∂v, whose direction
    takes its place, so that the normal is the limit from inside the patch.
    """
    at_u, d_u = _bernstein(u), _bernstein_derivative(u)
    at_v, d_v = _bernstein(v), _bernstein_derivative(v)
    along_u = _combine(patch, d_u, at_v)
    along_v = _combine(patch, at_u, d_v)
    if length(along_v) < 1e-9:
        along_v = scale(_combine(patch, d_u, d_v), 1 if u < 0.5 else -1)
    return _combine(patch, at_u, at_v), normalize(cross(along_u, along_v))


def teapot(cuts: int) -> list[Face]:
    """Quads with normals, `cuts`² per patch. y points up, the spout along x; it stands on y = 0."""
    faces = []
    steps = [i / cuts for i in range(cuts + 1)]
    for patch in patches():
        grid = [[_corner(patch, u, v) for v in steps] for u in steps]
        faces += [
            [grid[i][j], grid[i + 1][j], grid[i + 1][j + 1], grid[i][j + 1]]
            for i in range(cuts)
            for j in range(cuts)
        ]
    return faces


def _corner(patch: Patch, u: float, v: float) -> Corner:
    (x, y, z), (nx, ny, nz) = evaluate(patch, u, v)
    return (x, z, -y), (nx, nz, -ny)
