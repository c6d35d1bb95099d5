"""Checks of the generated scenes: `python3 -m unittest discover scenes`."""

import contextlib
import io
import itertools
import tempfile
import unittest
from collections import Counter
from pathlib import Path
from unittest import mock

import generate
from generator.catalogue import COMMITTED, sphereflake
from generator.mesh import Face, Obj, Vec3, cross, dot, flat, length, number, scale, sub
from generator.shapes import block, sphere
from generator.teapot import evaluate, patches, teapot

Triangle = list[tuple[Vec3, Vec3]]


def triangles(text: str) -> list[Triangle]:
    """The triangles of an OBJ file as `generator.mesh` writes it, faces cut into fans."""
    positions: list[Vec3] = []
    normals: list[Vec3] = []
    result = []
    for words in map(str.split, text.splitlines()):
        match words:
            case ["v", x, y, z]:
                positions.append((float(x), float(y), float(z)))
            case ["vn", x, y, z]:
                normals.append((float(x), float(y), float(z)))
            case ["f", *texts]:
                corners = []
                for corner in texts:
                    v, n = (int(index) for index in corner.split("//"))
                    assert v >= 1 and n >= 1, "indices start at 1"
                    corners.append((positions[v - 1], normals[n - 1]))
                result += [[corners[0], b, c] for b, c in itertools.pairwise(corners[1:])]
    return result


def written(faces: list[Face]) -> list[Triangle]:
    """The triangles as they arrive in a file: rounded, and without the degenerate ones."""
    obj = Obj()
    obj.add("object", "material", faces)
    return triangles(obj.text("", ""))


def area_vector(triangle: Triangle) -> Vec3:
    a, b, c = (position for position, _ in triangle)
    return scale(cross(sub(b, a), sub(c, a)), 0.5)


def volume(surface: list[Triangle]) -> float:
    """Of a closed surface; negative if it is inside out."""
    return sum(dot(triangle[0][0], area_vector(triangle)) for triangle in surface) / 3


class Scenes(unittest.TestCase):
    def test_triangles(self) -> None:
        """Not degenerate, with unit normals on the side of the winding."""
        for scene in (*(make() for make in COMMITTED), sphereflake(levels=1)):
            with self.subTest(scene.name):
                surface = triangles(scene.obj.text("", ""))
                self.assertGreater(len(surface), 0)
                for triangle in surface:
                    area = area_vector(triangle)
                    sides = [length(sub(triangle[i][0], triangle[i - 1][0])) for i in range(3)]
                    # The height over the longest side: three units of the last written decimal.
                    self.assertGreater(2 * length(area) / max(sides), 3e-4, triangle)
                    for _, normal in triangle:
                        self.assertAlmostEqual(length(normal), 1, delta=1e-3)
                        self.assertGreater(dot(normal, area), 0, triangle)

    def test_every_material_exists(self) -> None:
        for make in COMMITTED:
            scene = make()
            used = {line for line in scene.obj.text("", "").splitlines() if line.startswith("usemtl ")}
            defined = {line for line in scene.mtl.splitlines() if line.startswith("newmtl ")}
            self.assertGreater(len(used), 0, scene.name)
            self.assertEqual({line[3:] for line in used}, {line[3:] for line in defined}, scene.name)

    def test_check(self) -> None:
        """`--check` accepts what was written, and neither a changed nor a missing file."""
        with tempfile.TemporaryDirectory() as folder, mock.patch.object(generate, "HERE", Path(folder)):

            def run(*arguments: str) -> int:
                argv = mock.patch("sys.argv", ["generate.py", *arguments])
                with argv, contextlib.redirect_stderr(io.StringIO()):
                    return generate.main()

            self.assertEqual(run("--check"), 1)
            self.assertEqual(run(), 0)
            self.assertEqual(run("--check"), 0)
            path = Path(folder, "caustic", "caustic.mtl")
            path.write_text(path.read_text() + "\n")
            self.assertEqual(run("--check"), 1)


class Shapes(unittest.TestCase):
    def test_closed_surfaces(self) -> None:
        """Each edge lies between two triangles, and the outside is outside."""
        # A sphere's volume lacks what lies between it and its triangles, about 1.5 % here.
        for name, faces, expected, tolerance in (
            ("sphere", sphere(10), 4.18879, 0.06),
            ("block", block(1, 2, 0.5, 0.25, 3, turned=False), 1.5, 1e-9),
            ("turned block", block(1, 2, 0.5, 0.25, 3, turned=True), 1.5, 1e-9),
        ):
            with self.subTest(name):
                surface = written(faces)
                edges = Counter((t[i - 1][0], t[i][0]) for t in surface for i in range(3))
                self.assertEqual(set(edges.values()), {1})
                self.assertEqual({(b, a) for a, b in edges}, set(edges))
                self.assertAlmostEqual(volume(surface), expected, delta=tolerance)
                self.assertLess(volume([triangle[::-1] for triangle in surface]), 0)

    def test_sphere_has_the_promised_number_of_triangles(self) -> None:
        self.assertEqual(len(written(sphere(10))), 2000)

    def test_numbers_are_short_and_never_minus_zero(self) -> None:
        texts = [number(x) for x in (-0.00001, 2.0, 0.12345678, -10.5)]
        self.assertEqual(texts, ["0", "2", "0.1235", "-10.5"])

    def test_faces_without_area_vanish(self) -> None:
        a, b, c = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)
        self.assertEqual(len(written([flat(a, b, c, c)])), 1)
        self.assertEqual(len(written([[(a, c), (b, c), (b, c)]])), 0)


class Teapot(unittest.TestCase):
    def test_number_of_triangles(self) -> None:
        """Two per quad; one where the quad ends in a pole: 4 patches of the lid, 4 of the bottom."""
        self.assertEqual(len(list(patches())), 32)
        self.assertEqual(len(written(teapot(8))), 32 * 64 * 2 - 8 * 8)

    def test_normals_at_the_poles(self) -> None:
        """Along the axis, and the limits of the normals nearby."""
        poles = 0
        for patch in patches():
            for u, inside in ((0.0, 1e-6), (1.0, 1 - 1e-6)):
                position, normal = evaluate(patch, u, 0.3)
                if len(set(patch[int(3 * u)])) == 1:
                    poles += 1
                    self.assertAlmostEqual(normal[2], 1 if position[2] > 1 else -1)
                    nearby = evaluate(patch, inside, 0.3)[1]
                    self.assertLess(length(sub(nearby, normal)), 1e-4)
        self.assertEqual(poles, 8)

    def test_normals_point_outwards(self) -> None:
        """At one place of each patch where it is plain what that means."""
        for i, patch in enumerate(patches()):
            position, normal = evaluate(patch, 0.25 if 16 <= i < 20 else 0.5, 0.5)
            x, y, _ = position
            if i < 4:  # the rim: up
                self.assertGreater(normal[2], 0)
            elif i < 12 or 16 <= i < 20:  # the body's side, the upper half of the knob: off the axis
                self.assertGreater(dot(normal, (x, y, 0.0)), 0)
            elif i < 16:  # the bottom: down
                self.assertLess(normal[2], 0)
            elif i < 24:  # the lid below the knob: up
                self.assertGreater(normal[2], 0)
            else:  # handle and spout: off the plane of symmetry
                self.assertGreater(normal[1] * y, 0)


if __name__ == "__main__":
    unittest.main()
