"""Random scenes are what their seed says, and are complete."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from nst_train.random_scenes import BRANCHES, images, random_scene, write
from nst_train.random_scenes.shapes import FRONT, ball, box, hills

SCENES = [(branch, index) for branch in BRANCHES for index in range(4)]


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
    named = {line.split()[1] for line in materials.splitlines() if line.startswith("map_Kd")}
    named |= {settings.get("environment", {}).get("image")} - {None}
    assert named == set(scene.images)
    assert 2 <= settings["integrator"]["max_depth"] <= 12
    assert 20 < settings["camera"]["vertical_fov"] < 110
    assert "Ke " in materials or "environment" in settings


def test_scenes_are_of_all_kinds() -> None:
    scenes = [random_scene(branch, index, seed=1) for branch, index in SCENES]
    texts = ["\n".join(scene.materials) + scene.settings for scene in scenes]
    for mark in ("illum 7", "Pm 1", "map_Kd", "Pr ", "Ke ", "image = ", "radiance = ", "max_depth = 8"):
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
