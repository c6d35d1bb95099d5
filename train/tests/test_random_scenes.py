"""Random scenes are what their seed says, and are complete."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from nst_train.random_scenes import BRANCHES, images, random_scene, write
from nst_train.random_scenes.meshes import bumps, knot, lathe, rod, star, superquadric
from nst_train.random_scenes.shapes import FRONT, ball, box, hills

SCENES = [(branch, index) for branch in BRANCHES for index in range(2)]


def test_a_seed_decides_every_byte_and_another_changes_them(tmp_path: Path) -> None:
    for branch in BRANCHES:
        first = random_scene(branch, 2, seed=5)
        path = write(first, tmp_path)
        assert path == tmp_path / f"{branch}-002" / f"{branch}-002.obj"
        stored = {file.name: file.read_bytes() for file in path.parent.iterdir()}
        assert stored == first.files() == random_scene(branch, 2, seed=5).files()
        for other in (random_scene(branch, 2, seed=6), random_scene(branch, 3, seed=5)):
            text = b"".join(other.files().values()).replace(other.name.encode(), first.name.encode())
            assert text != b"".join(stored.values())


@pytest.mark.parametrize(("branch", "index"), SCENES)
def test_files_fit_together(branch: str, index: int) -> None:
    scene = random_scene(branch, index, seed=1)
    files = {Path(name).suffix: content for name, content in scene.files().items()}
    lines = [line.split() for line in files[".obj"].decode().splitlines()]
    tables = {
        key: np.array([line[1:] for line in lines if line[0] == key], float) for key in ("v", "vt", "vn")
    }
    assert all(np.isfinite(table).all() for table in tables.values())
    if len(tables["vn"]):
        np.testing.assert_allclose(np.linalg.norm(tables["vn"], axis=1), 1, atol=1e-5)
    corners = [(word + "//").split("/")[:3] for line in lines if line[0] == "f" for word in line[1:]]
    for column, table in enumerate(tables.values()):
        named = {int(corner[column]) for corner in corners if corner[column]}
        assert named == set(range(1, len(table) + 1))

    materials = files[".mtl"].decode()
    used = {line[1] for line in lines if line[0] == "usemtl"}
    assert used == {line.split()[1] for line in materials.splitlines() if line.startswith("newmtl")}
    settings = tomllib.loads(files[".toml"].decode())
    keys = ("map_Kd", "map_Ke", "map_d", "bump")
    named = {line.split()[-1] for line in materials.splitlines() if line.startswith(keys)}
    named |= {settings.get("environment", {}).get("image")} - {None}
    assert named == set(scene.images)
    assert 2 <= settings["integrator"]["max_depth"] <= 12
    assert 20 < settings["camera"]["vertical_fov"] < 110
    assert "Ke " in materials or "environment" in settings


def test_scenes_are_of_all_kinds() -> None:
    scenes = [random_scene(branch, index, seed=1) for branch, index in SCENES]
    texts = ["\n".join(scene.materials) + scene.settings for scene in scenes]
    marks = ("illum 7", "Pm 1", "map_Kd", "Pr ", "Ke ", "image = ", "radiance = ", "max_depth = 8")
    for mark in (
        *marks,
        "map_Ke",
        "map_d",
        "bump",
        "Ps ",
        "Pc ",
        "aniso",
        'light = "',
        "max_depth = 12",
    ):
        assert 0 < sum(mark in text for text in texts) < len(texts), mark
    lamps = [text.count("Ke ") for text in texts]
    assert max(lamps) > 20 and lamps.count(1) > 3


def test_bodies_wind_outwards() -> None:
    """Glass that winds inside out would be turned by the renderer, with a note."""
    centre = np.array([1.0, 2.0, 3.0])
    polygons, normals, _ = ball(centre, 0.5)
    sides = box(centre, np.diag([0.5, 1.0, 2.0]))
    assert len(sides) == 6
    for polygon in polygons + sides:
        normal = np.cross(polygon[1] - polygon[0], polygon[2] - polygon[0])
        assert normal @ (polygon.mean(0) - centre) > 0
    for polygon, smooth in zip(polygons, normals, strict=True):
        np.testing.assert_allclose(polygon, centre + 0.5 * smooth)
    assert (sides[FRONT][:, 2] == 5).all()

    # Hills of slope 1/2 along x.
    polygons, normals, _ = hills(np.broadcast_to(np.linspace(0, 2, 5), (5, 5)), 2.0)
    assert len(polygons) == 16
    for polygon, smooth in zip(polygons, normals, strict=True):
        normal = np.cross(polygon[1] - polygon[0], polygon[2] - polygon[0])
        np.testing.assert_allclose(smooth, np.tile(normal / np.linalg.norm(normal), (4, 1)), atol=1e-12)


def test_meshes_wind_outwards_and_have_their_normals() -> None:
    centre = np.array([1.0, 2.0, 3.0])
    rng = np.random.default_rng(1)
    axes = np.array([0.5, 1.0, 2.0])
    for polygon, smooth in zip(*star(centre, superquadric(2, axes))[:2], strict=True):  # an ellipsoid
        gradient = (polygon - centre) / axes**2
        np.testing.assert_allclose(np.linalg.norm((polygon - centre) / axes, axis=1), 1, atol=1e-9)
        np.testing.assert_allclose(smooth, gradient / np.linalg.norm(gradient, axis=1)[:, None], atol=1e-5)
    profile = np.array([[0.5, 0.0], [1.0, 0.0], [1.0, 1.0], [0.5, 1.0]])
    along = np.array([0.0, 1.0, 0.0])
    bodies = {
        "star": star(centre, bumps(rng, 1.0, 5, 0.3)),
        "lathe": lathe(centre, profile),
        "knot": knot(rng, centre, 1.0),
        "rod": rod(centre, centre + along, 0.1),
    }
    for name, (polygons, normals, coordinates) in bodies.items():
        assert len(polygons) == len(normals) == len(coordinates), name
        for polygon, smooth in zip(polygons, normals, strict=True):
            flat = np.cross(polygon[2] - polygon[0], polygon[-1] - polygon[1])
            assert (smooth @ flat > 0).all(), name
            np.testing.assert_allclose(np.linalg.norm(smooth, axis=1), 1)
    for name in ("star", "lathe", "knot"):
        # Closed, and inside is behind: Gauss' theorem gives the volume.
        volume = 0.0
        for polygon in bodies[name][0]:
            for i in range(1, len(polygon) - 1):
                volume += np.linalg.det(np.stack([polygon[0], polygon[i], polygon[i + 1]]) - centre) / 6
        assert volume > 0.05, name
    for polygon, smooth in zip(*bodies["rod"][:2], strict=True):
        outwards = (polygon - centre) * [1, 0, 1] / 0.1
        np.testing.assert_allclose(smooth, outwards, atol=1e-9)


def test_textures_have_the_frequencies_they_were_given() -> None:
    def roughness(image: np.ndarray) -> float:
        return np.abs(np.diff(image, axis=0)).mean() / image.std()

    smooth, rough = (images.fractal(np.random.default_rng(1), 64, falloff) for falloff in (1.6, 0.0))
    assert smooth.min() == rough.min() == 0 and smooth.max() == rough.max() == 1
    assert roughness(rough) > 3 * roughness(smooth)
    ends = np.abs(smooth[0] - smooth[-1]).mean()
    assert ends < 3 * np.abs(np.diff(smooth, axis=0)).mean()  # it repeats
    assert 0.1 < images.writing(np.random.default_rng(1), 64).mean() < 0.6
    kinds = [images.picture(np.random.default_rng(seed)) for seed in range(12)]
    assert all(kind.shape == (128, 128, 3) and kind.min() >= 0 and kind.max() <= 1 for kind in kinds)
    found = [roughness(kind) for kind in kinds]
    assert max(found) > 10 * min(found)


def test_images_contain_what_they_were_given() -> None:
    colours = np.array(
        [[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [[1.0] * 3, [0.5] * 3, [0.0] * 3]]
    )
    content = images.bmp(colours)
    assert len(content) == 54 + 2 * 12 and int.from_bytes(content[2:6], "little") == len(content)
    assert content[54:63] == bytes([255, 255, 255, 128, 128, 128, 0, 0, 0])  # the last row first
    assert content[66:75] == bytes([0, 0, 255, 0, 255, 0, 255, 0, 0])  # blue, green, red

    radiance = np.array([[[0.0, 0.0, 0.0], [1000.0, 500.0, 0.001], [0.3, 0.2, 0.1]]])
    head, texels = images.hdr(radiance).split(b"+X 3\n")
    assert head.endswith(b"\n\n-Y 1 ")
    rgbe = np.frombuffer(texels, np.uint8).reshape(1, 3, 4).astype(float)
    read = np.where(rgbe[..., 3:] > 0, rgbe[..., :3] * 2.0 ** (rgbe[..., 3:] - 136), 0.0)
    # Eight bits, cut: less than 1/128 of the largest of the three.
    assert (np.abs(read - radiance) < radiance.max(-1, keepdims=True) / 128 + 1e-12).all()
