"""Rectangles, boxes and spheres."""

from generator.mesh import Face, Vec3, add, cross, dot, flat, normalize, scale, sub


def rectangle(centre: Vec3, half_u: Vec3, half_v: Vec3) -> list[Face]:
    """A rectangle from its centre to the middles of two sides; it faces `half_u` × `half_v`."""
    low, high = sub(centre, half_v), add(centre, half_v)
    return [flat(sub(low, half_u), add(low, half_u), add(high, half_u), sub(high, half_u))]


def facing(centre: Vec3, target: Vec3, half_width: float, half_height: float) -> list[Face]:
    """A rectangle that faces `target`, with two horizontal sides. Not for looking straight down."""
    forward = normalize(sub(target, centre))
    right = normalize(cross((0, 1, 0), forward))
    up = cross(forward, right)
    return rectangle(centre, scale(right, half_width), scale(up, half_height))


def floor(half_size: float, y: float = 0.0) -> list[Face]:
    """A horizontal square around the y axis, facing up."""
    return rectangle((0, y, 0), (0, 0, half_size), (half_size, 0, 0))


def box(centre: Vec3, half_u: Vec3, half_v: Vec3, half_w: Vec3) -> list[Face]:
    """A box, facing outwards if the three half edges are right-handed."""
    axes = (half_u, half_v, half_w)
    faces = []
    for i in range(3):
        w, u, v = axes[i], axes[i - 2], axes[i - 1]
        faces += rectangle(add(centre, w), u, v)
        faces += rectangle(sub(centre, w), v, u)
    return faces


def inverted(faces: list[Face]) -> list[Face]:
    """The same faces, turned round."""
    return [[(p, scale(n, -1)) for p, n in reversed(face)] for face in faces]


def block(x: float, z: float, half_x: float, half_z: float, height: float, turned: bool) -> list[Face]:
    """A box that stands on the plane y = 0; `turned` by 36.87° (3:4:5) about its own axis."""
    c, s = (0.8, 0.6) if turned else (1.0, 0.0)
    up = (0.0, height / 2, 0.0)
    return box((x, height / 2, z), up, (half_z * s, 0.0, half_z * c), (half_x * c, 0.0, -half_x * s))


def sphere(frequency: int) -> list[Face]:
    """The unit sphere with its normals: an icosahedron whose edges are cut into `frequency` parts.

    It has 20 `frequency`² triangles.
    """
    g = (1 + 5**0.5) / 2
    rectangle_corners = [(1.0, g), (-1.0, g), (-1.0, -g), (1.0, -g)]
    corners: list[Vec3] = [(0.0, a, b) for a, b in rectangle_corners]
    corners += [(b, 0.0, a) for a, b in rectangle_corners]
    corners += [(a, b, 0.0) for a, b in rectangle_corners]
    faces = []
    for a, b, c in _icosahedron(corners):

        def point(i: int, j: int, a: Vec3 = a, b: Vec3 = b, c: Vec3 = c) -> Vec3:
            along_b, along_c = scale(sub(b, a), i / frequency), scale(sub(c, a), j / frequency)
            return normalize(add(a, add(along_b, along_c)))

        for i in range(frequency):
            for j in range(frequency - i):
                triangles = [(point(i, j), point(i + 1, j), point(i, j + 1))]
                if i + j + 1 < frequency:
                    triangles.append((point(i + 1, j), point(i + 1, j + 1), point(i, j + 1)))
                faces += [[(p, p) for p in triangle] for triangle in triangles]
    return faces


def _icosahedron(corners: list[Vec3]) -> list[tuple[Vec3, Vec3, Vec3]]:
    """The faces of the icosahedron: all triples of neighbours, turned to face outwards."""

    def close(a: Vec3, b: Vec3) -> bool:
        return abs(dot(sub(a, b), sub(a, b)) - 4) < 1e-9

    faces = []
    for i, a in enumerate(corners):
        for j, b in enumerate(corners[:i]):
            for c in corners[:j]:
                if close(a, b) and close(b, c) and close(c, a):
                    outwards = dot(cross(sub(b, a), sub(c, a)), a) > 0
                    faces.append((a, b, c) if outwards else (a, c, b))
    return faces
