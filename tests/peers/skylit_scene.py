"""Writes the scene `tests/data/skylit`: boxes on a floor, lit by an image of a sky alone.

    python3 tests/peers/skylit_scene.py

The sky is a Radiance file of 64 by 32 texels: brighter towards the zenith, another colour on each
side, and one texel that is a sun. The scene turns it by 30 degrees.
"""

import math
from pathlib import Path

FOLDER = Path(__file__).parent.parent / "data/skylit"
SIZE = 64, 32
SUN = 50, 8
"""Column and row: a quarter of the way down, in front of the camera and to its left."""
SUN_RADIANCE = 3000.0

MTL = """newmtl floor
Kd 0.6 0.6 0.6
newmtl red
Kd 0.7 0.2 0.1
newmtl glossy
Kd 0.2 0.4 0.7
Pr 0.4
"""

TOML = """[camera]
position = [0.5, 2.0, 5.0]
target = [0.0, 0.7, 0.0]
up = [0.0, 1.0, 0.0]
vertical_fov = 45.0

[film]
size = [128, 128]

[integrator]
kind = "path"
max_depth = 4

[environment]
radiance = [1.0, 0.9, 0.8]
image = "sky.hdr"
rotation = 30.0
"""


def rgbe(color: list[float]) -> bytes:
    """Three mantissas of 256ths and their exponent, as Radiance stores a texel."""
    exponent = math.frexp(max(color))[1]
    return bytes([*(int(x * 2.0 ** (8 - exponent)) for x in color), exponent + 128])


def texel(column: int, row: int) -> list[float]:
    if (column, row) == SUN:
        return [SUN_RADIANCE, 0.9 * SUN_RADIANCE, 0.7 * SUN_RADIANCE]
    height = 1.0 - (row + 0.5) / SIZE[1]
    turn = 2.0 * math.pi * (column + 0.5) / SIZE[0]
    return [height + 0.3 * (1.0 + math.sin(turn)), height + 0.1, height + 0.3 * (1.0 + math.cos(turn))]


def sky() -> bytes:
    width, height = SIZE
    header = f"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y {height} +X {width}\n"
    # A line that started with 2, 2, 0, 64 would count as compressed; none does.
    texels = (rgbe(texel(column, row)) for row in range(height) for column in range(width))
    return header.encode() + b"".join(texels)


def box(center: list[float], half: list[float], turn: float) -> list[list[float]]:
    """Corners, numbered by the bits of x, y, z; turned about +y by radians."""
    corners = []
    for i in range(8):
        x, y, z = (half[axis] * (1 if i >> axis & 1 else -1) for axis in range(3))
        x, z = x * math.cos(turn) + z * math.sin(turn), z * math.cos(turn) - x * math.sin(turn)
        corners.append([center[0] + x, center[1] + y, center[2] + z])
    return corners


FACES = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
"""Of a box, counterclockwise from outside."""


def obj() -> str:
    lines = ["mtllib skylit.mtl", "v -3 0 3", "v 3 0 3", "v 3 0 -3", "v -3 0 -3"]
    lines += ["usemtl floor", "f 1 2 3 4"]
    boxes = [
        ("red", box([-0.8, 0.6, 0.2], [0.5, 0.6, 0.5], 0.4)),
        ("glossy", box([0.9, 0.9, -0.4], [0.5, 0.9, 0.4], -0.5)),
    ]
    for count, (material, corners) in enumerate(boxes):
        lines += [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in corners]
        lines.append(f"usemtl {material}")
        first = 5 + 8 * count
        lines += ["f " + " ".join(str(first + i) for i in face) for face in FACES]
    return "\n".join(lines) + "\n"


def main() -> None:
    FOLDER.mkdir(exist_ok=True)
    for name, text in [("skylit.obj", obj()), ("skylit.mtl", MTL), ("skylit.toml", TOML)]:
        (FOLDER / name).write_text(text, encoding="utf-8")
    (FOLDER / "sky.hdr").write_bytes(sky())


if __name__ == "__main__":
    main()
