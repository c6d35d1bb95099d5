"""Meshes, and the text of OBJ files."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from math import sqrt

Vec3 = tuple[float, float, float]

Corner = tuple[Vec3, Vec3]
"""Position and unit normal.

Flat faces have normals too: some readers, tobj among them, make up normals for faces that have none
if other faces of the file have some.
"""

Face = list[Corner]
"""Three or four corners, counterclockwise seen from outside."""

DIGITS = 4
"""Decimals of every number in an OBJ file. What rounds to the same numbers is the same vertex."""


def add(a: Vec3, b: Vec3) -> Vec3:
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def sub(a: Vec3, b: Vec3) -> Vec3:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def scale(a: Vec3, s: float) -> Vec3:
    return (a[0] * s, a[1] * s, a[2] * s)


def dot(a: Vec3, b: Vec3) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Vec3, b: Vec3) -> Vec3:
    return (
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    )


def length(a: Vec3) -> float:
    return sqrt(dot(a, a))


def normalize(a: Vec3) -> Vec3:
    return scale(a, 1 / length(a))


def number(x: float) -> str:
    """`x` with at most `DIGITS` decimals, as short as possible, and never -0."""
    return f"{round(x, DIGITS) + 0.0:.{DIGITS}f}".rstrip("0").rstrip(".")


def numbers(values: Iterable[float]) -> str:
    return " ".join(number(x) for x in values)


@dataclass
class Obj:
    """An OBJ file in the making. Objects share vertices and normals that are written alike."""

    _positions: dict[str, int] = field(default_factory=dict)
    _normals: dict[str, int] = field(default_factory=dict)
    _objects: list[str] = field(default_factory=list)

    def add(self, name: str, material: str, faces: Iterable[Face]) -> None:
        """Adds an object.

        Corners that coincide with the one before are left out, and so are faces of less than three:
        quads that end in a pole become triangles.
        """
        lines = [f"o {name}", f"usemtl {material}"]
        for face in faces:
            corners = [self._index(corner) for corner in face]
            corners = [c for i, c in enumerate(corners) if c[0] != corners[i - 1][0]]
            if len(corners) >= 3:
                lines.append("f " + " ".join(text for _, text in corners))
        self._objects.append("\n".join(lines) + "\n")

    def _index(self, corner: Corner) -> tuple[int, str]:
        """The number of a corner's vertex, and the text that stands for the corner in a face."""
        position, normal = corner
        v = self._positions.setdefault(numbers(position), len(self._positions) + 1)
        n = self._normals.setdefault(numbers(normal), len(self._normals) + 1)
        return v, f"{v}//{n}"

    def text(self, note: str, library: str) -> str:
        """The file: a comment, the name of the MTL file, vertices, normals, objects."""
        parts = [f"# {line}\n" for line in note.splitlines()]
        parts.append(f"mtllib {library}\n\n")
        parts.extend(f"v {v}\n" for v in self._positions)
        parts.extend(f"vn {n}\n" for n in self._normals)
        parts.extend(f"\n{o}" for o in self._objects)
        return "".join(parts)


def flat(*positions: Vec3) -> Face:
    """A face whose normals are its own."""
    a, b, c = positions[:3]
    normal = normalize(cross(sub(b, a), sub(c, a)))
    return [(position, normal) for position in positions]


def move(faces: Sequence[Face], offset: Vec3, size: float = 1.0) -> list[Face]:
    """The faces, first scaled about the origin, then moved."""
    return [[(add(scale(p, size), offset), n) for p, n in face] for face in faces]
