"""The scenes."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from generator.mesh import Obj, Vec3, add, cross, move, normalize, numbers, scale
from generator.shapes import block, box, facing, floor, inverted, rectangle, sphere
from generator.teapot import teapot


@dataclass(frozen=True)
class Scene:
    """A folder's worth of text."""

    name: str
    note: str
    """The comment at the top of the OBJ file."""
    obj: Obj
    mtl: str
    toml: str

    def files(self) -> dict[str, str]:
        """Text by file name."""
        return {
            f"{self.name}.obj": self.obj.text(self.note, f"{self.name}.mtl"),
            f"{self.name}.mtl": self.mtl,
            f"{self.name}.toml": self.toml,
        }


def sidecar(position: Vec3, target: Vec3, up: Vec3, fov: float, size: int, depth: int) -> str:
    """The TOML file: a square film, `fov` in degrees."""
    camera = (("position", position), ("target", target), ("up", up))
    lines = [f"{key} = [{', '.join(str(float(x)) for x in value)}]" for key, value in camera]
    return (
        "[camera]\n" + "\n".join(lines) + f"\nvertical_fov = {float(fov)}\n\n"
        f"[film]\nsize = [{size}, {size}]\n\n"
        f'[integrator]\nkind = "path"\nmax_depth = {depth}\n'
    )


Y_UP = (0.0, 1.0, 0.0)


def plane(name: str, material: str, radiance: float) -> Scene:
    """A plane across the view, and a rod-shaped light behind the camera, askew and off centre."""
    obj = Obj()
    obj.add("plane", "plane", rectangle((0, 0, 0), (8, 0, 0), (0, 8, 0)))
    half_length, half_width = (1.2, 0.9, 0.0), (-0.03, 0.04, 0.0)
    obj.add("rod", "light", rectangle((-0.2, 0.15, 1.1), half_length, half_width))
    return Scene(
        name,
        "A plane, seen at a right angle, and a rod-shaped light behind the camera.",
        obj,
        f"newmtl plane\n{material}\nnewmtl light\nKd 0 0 0\nKe {numbers([radiance] * 3)}\n",
        sidecar((0, 0, 1), (0, 0, 0), Y_UP, 112, 128, 2),
    )


def teapot_scene(name: str, material: str) -> Scene:
    """The teapot on a plane, under a rectangular light."""
    obj = Obj()
    obj.add("plane", "plane", floor(40))
    obj.add("light", "light", facing((-4, 8, 4), (0, 1, 0), 2.2, 1.7))
    obj.add("teapot", "teapot", teapot(8))
    return Scene(
        name,
        "The Utah teapot (Martin Newell, 1975) on a plane, under a rectangular light.",
        obj,
        f"newmtl plane\nKd 0.6 0.6 0.6\n\nnewmtl teapot\n{material}\nnewmtl light\nKd 0 0 0\nKe 22 22 22\n",
        sidecar((2, 5, 9), (0.4, 1.2, 0), Y_UP, 40, 128, 2),
    )


def caustic() -> Scene:
    """A glass sphere above a plane and before a wall, under a small light."""
    obj = Obj()
    obj.add("floor", "floor", floor(6))
    obj.add("wall", "wall", rectangle((0, 4, -3), (6, 0, 0), (0, 4, 0)))
    obj.add("light", "light", facing((-2.4, 5, 1.2), (0, 1.2, 0), 0.15, 0.15))
    obj.add("sphere", "glass", move(sphere(10), (0, 1.25, 0)))
    return Scene(
        "caustic",
        "A glass sphere above a plane, under a small bright light.",
        obj,
        "newmtl floor\nKd 0.7 0.66 0.6\n\nnewmtl wall\nKd 0.2 0.35 0.5\n\n"
        "newmtl glass\nKd 0 0 0\nKs 1 1 1\nNi 1.5\nd 0\nillum 7\n\n"
        "newmtl light\nKd 0 0 0\nKe 1000 880 720\n",
        sidecar((1, 3, 6.5), (0.3, 0.75, 0), Y_UP, 36, 256, 8),
    )


BLOCKS = (
    # x, z, half the width, half the depth, height, turned.
    (-2.6, -2.4, 0.7, 0.7, 2.6, True),
    (0.3, -2.8, 0.9, 0.5, 1.5, False),
    (2.7, -2.2, 0.6, 0.6, 3.1, False),
    (-1.0, -0.3, 0.5, 0.5, 1.2, False),
    (1.3, 0.1, 0.6, 0.4, 0.8, True),
    (-2.8, 1.3, 0.4, 0.6, 0.7, True),
    (2.9, 1.6, 0.5, 0.5, 1.0, True),
)


def many_lights() -> Scene:
    """A room with blocks, and 64 square lights whose powers span four decades.

    The weaker a light, the lower it hangs, so that weak ones matter somewhere, too.
    """
    obj = Obj()
    obj.add("room", "wall", inverted(box((0, 2, 0), (4, 0, 0), (0, 2, 0), (0, 0, 4))))
    for i, (x, z, half_x, half_z, height, turned) in enumerate(BLOCKS):
        obj.add(f"block{i}", "block", block(x, z, half_x, half_z, height, turned))
    mtl = "newmtl wall\nKd 0.7 0.7 0.7\n\nnewmtl block\nKd 0.6 0.55 0.5\n"
    for i, (x, z) in zip(range(64), free_places(), strict=False):
        strength = i / 63
        height, side = 0.05 * 70**strength, 0.02 * 18**strength
        colour = hue(i * 0.618034)
        radiance = scale(colour, 0.00022 * 10 ** (4 * strength) / (side * side * luminance(colour)))
        obj.add(f"light{i}", f"light{i}", inverted(move(floor(side / 2), (x, height, z))))
        mtl += f"\nnewmtl light{i}\nKd 0 0 0\nKe {numbers(radiance)}\n"
    return Scene(
        "many-lights",
        "A room with blocks and 64 lights, whose powers go from 1 to 10,000.",
        obj,
        mtl,
        sidecar((0.5, 3.2, 3.9), (0, 0.9, -1), Y_UP, 75, 256, 4),
    )


def free_places() -> Iterator[tuple[float, float]]:
    """Places on the floor clear of the blocks, evenly spread by the R2 sequence (M. Roberts, 2018)."""
    i = 0
    while True:
        i += 1
        x, z = (i * 0.7548776662 % 1) * 7.4 - 3.7, (i * 0.5698402910 % 1) * 7.4 - 3.7
        reaches = (1.3 * max(half_x, half_z) + 0.15 for _, _, half_x, half_z, _, _ in BLOCKS)
        clear = (max(abs(x - b[0]), abs(z - b[1])) > reach for b, reach in zip(BLOCKS, reaches, strict=True))
        if all(clear):
            yield x, z


def hue(turn: float) -> Vec3:
    """A colour of the colour wheel, not quite pure; 1 is a whole turn. Its largest component is 1."""
    r, g, b = (min(max(abs((turn + shift) % 1 * 6 - 3) - 1, 0.0), 1.0) for shift in (0, 2 / 3, 1 / 3))
    return (0.2 + 0.8 * r, 0.2 + 0.8 * g, 0.2 + 0.8 * b)


def luminance(rgb: Vec3) -> float:
    return 0.2126 * rgb[0] + 0.7152 * rgb[1] + 0.0722 * rgb[2]


def sphereflake(levels: int = 3) -> Scene:
    """Spheres on spheres of 320 triangles each: 820 of them in three levels above the first."""
    obj = Obj()
    obj.add("floor", "floor", floor(30))
    obj.add("light", "light", facing((-5, 9, 6), (0, 1, 0), 2, 2))
    unit = sphere(4)
    for i, (centre, radius, level) in enumerate(flake((0, 2, 0), 1, Y_UP, levels)):
        obj.add(f"sphere{i}", f"level{level}", move(unit, centre, radius))
    return Scene(
        "big",
        "A sphereflake (after Eric Haines, Standard Procedural Databases, 1987).",
        obj,
        "newmtl floor\nKd 0.6 0.6 0.6\n\nnewmtl level3\nKd 0.75 0.25 0.15\n\n"
        "newmtl level2\nKd 0.8 0.6 0.2\n\nnewmtl level1\nKd 0.25 0.55 0.6\n\n"
        "newmtl level0\nKd 0.8 0.8 0.75\n\nnewmtl light\nKd 0 0 0\nKe 28 26 22\n",
        sidecar((2.5, 4.6, 5.8), (0, 1.8, 0), Y_UP, 35, 512, 8),
    )


def flake(centre: Vec3, radius: float, axis: Vec3, level: int) -> Iterator[tuple[Vec3, float, int]]:
    """Centres, radii and levels: each sphere bears nine of a third its size, until level 0.

    Six stand around its equator, three between the equator and the end of its axis.
    """
    yield centre, radius, level
    if level == 0:
        return
    side = normalize(cross(axis, (0.6, 0, 0.8) if abs(axis[1]) > 0.5 else Y_UP))
    across = cross(axis, side)
    half, root = 0.5, 0.75**0.5
    hexagon = [(1, 0), (half, root), (-half, root), (-1, 0), (-half, -root), (half, -root)]
    triangle = [(root, half), (-root, half), (0, -1)]
    places = [(x, y, 0.0) for x, y in hexagon] + [(x, y, 1.3) for x, y in triangle]
    for x, y, z in places:
        outwards = normalize(add(add(scale(side, x), scale(across, y)), scale(axis, z)))
        yield from flake(add(centre, scale(outwards, radius * 4 / 3)), radius / 3, outwards, level - 1)


LAMBERT = "Kd 0.5 0.5 0.5\n"

COMMITTED: tuple[Callable[[], Scene], ...] = (
    lambda: plane("plane-lambert", LAMBERT, 25),
    lambda: plane("plane-ggx", "Kd 0.5 0.5 0.5\nPr 0.35\nPm 0.25\n", 25),
    lambda: teapot_scene("teapot-diffuse", LAMBERT),
    lambda: teapot_scene("teapot-glossy", "Kd 0.6 0.6 0.6\nPr 0.25\nPm 0.3\n"),
    caustic,
    many_lights,
)
