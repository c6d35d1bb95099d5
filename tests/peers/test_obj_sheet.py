"""The contact sheet's flags: a flat and an invisible object are noticed, a shaded one passes."""

import csv
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import obj_sheet
from obj_sheet import Row, measure

SIZE = 40

TETRAHEDRON = """\
v 1 1 1
v 1 -1 -1
v -1 1 -1
v -1 -1 1
f 1 3 2
f 1 2 4
f 1 4 3
f 2 3 4
"""


def square(inside: np.ndarray | float, outside: float) -> Image.Image:
    """A grey picture whose middle, of half its width and height, has other values."""
    values = np.full((SIZE, SIZE), outside)
    values[SIZE // 4 : -SIZE // 4, SIZE // 4 : -SIZE // 4] = inside
    return Image.fromarray(values.astype(np.uint8))


SILHOUETTE = square(0, 255)
# From left to right.
SHADED = np.tile(np.linspace(60, 200, SIZE // 2), (SIZE // 2, 1))


def measured(picture: Image.Image, silhouette: Image.Image = SILHOUETTE) -> Row:
    row = Row("x.obj")
    measure(row, picture, silhouette)
    return row


def test_a_shaded_object_has_no_flag() -> None:
    row = measured(square(SHADED, 255))
    assert row.flags == []
    assert (row.share, row.outline) == (0.25, 1.0)
    # The 5th and the 95th percentile lie 90 % of the range apart.
    assert row.levels == pytest.approx(0.9 * 140, abs=1)


@pytest.mark.parametrize("noise", [0, 4])
def test_a_flat_object_is_noticed(noise: int) -> None:
    rng = np.random.default_rng(1)
    greys = 128 + rng.integers(-noise, noise + 1, (SIZE // 2, SIZE // 2))
    row = measured(square(greys, 255))
    assert row.flags == ["flat"]
    assert row.levels == pytest.approx(2 * noise, abs=1)


def test_an_object_like_the_background_is_noticed() -> None:
    assert measured(square(200, 200)).flags == ["flat", "blank"]
    assert measured(square(201, 200)).flags == ["flat", "blank"]  # rounding
    assert measured(square(204, 200)).flags == ["flat"]
    assert measured(square(200, 200)).outline == 0.0


def test_a_picture_without_the_object_is_blank() -> None:
    row = measured(square(SHADED, 255), square(255, 255))
    assert row.flags == ["blank"]
    assert row.share == 0.0


def test_the_background_does_not_count_as_shading() -> None:
    ramp = np.tile(np.linspace(0, 255, SIZE), (SIZE, 1))
    ramp[SIZE // 4 : -SIZE // 4, SIZE // 4 : -SIZE // 4] = 100
    assert "flat" in measured(Image.fromarray(ramp.astype(np.uint8))).flags


def test_an_object_may_fill_the_picture_or_have_no_whole_pixel() -> None:
    filled = measured(square(SHADED, 255), square(0, 0))
    assert (filled.share, filled.flags, filled.outline) == (1.0, [], "")
    thin = measured(square(SHADED, 255), square(100, 255))
    assert (thin.share, thin.flags, thin.outline) == (0.25, [], "")


def test_half_of_the_outline_is_lost() -> None:
    halves = np.full((SIZE // 2, SIZE // 2), 200)
    halves[: SIZE // 4] = np.linspace(50, 150, SIZE // 2)
    assert measured(square(halves, 200)).outline == pytest.approx(0.5, abs=0.01)


def run(monkeypatch: pytest.MonkeyPatch, nst: Path, folder: Path, *options: str) -> dict[str, dict[str, str]]:
    """The rows of the CSV file, by the files' names."""
    arguments = [str(folder), "-o", str(folder / "out"), "--nst", str(nst), "--size", "48", "--spp", "4"]
    monkeypatch.setattr("sys.argv", ["obj_sheet.py", *arguments, *options])
    obj_sheet.main()
    with (folder / "out/sheet.csv").open(newline="", encoding="utf-8") as file:
        return {row["file"]: row for row in csv.DictReader(file)}


def test_a_folder(nst_binary: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "deep").mkdir()
    (tmp_path / "tetrahedron.obj").write_text(TETRAHEDRON)
    # In a white room without shadows, a convex object is a flat silhouette.
    (tmp_path / "deep/white.OBJ").write_text(TETRAHEDRON)
    (tmp_path / "deep/white.toml").write_text("[environment]\nradiance = [1.0, 1.0, 1.0]\n")
    # White, too, it cannot be seen at all.
    (tmp_path / "lost.obj").write_text("mtllib lost.mtl\nusemtl white\n" + TETRAHEDRON)
    (tmp_path / "lost.mtl").write_text("newmtl white\nKd 1 1 1\n")
    (tmp_path / "lost.toml").write_text("[environment]\nradiance = [1.0, 1.0, 1.0]\n")
    (tmp_path / "points.obj").write_text("v 0 0 0\nv 1 0 0\np 1 2\n")
    rows = run(monkeypatch, nst_binary, tmp_path)
    assert sorted(rows) == ["deep/white.OBJ", "lost.obj", "points.obj", "tetrahedron.obj"]

    assert rows["deep/white.OBJ"]["flags"] == "flat"
    assert float(rows["deep/white.OBJ"]["levels"]) == 0
    assert rows["lost.obj"]["flags"] == "flat | blank"
    assert rows["points.obj"]["flags"] == "refused"
    assert "no faces" in rows["points.obj"]["error"]
    # The silhouette does not depend on materials.
    assert rows["tetrahedron.obj"]["share"] == rows["lost.obj"]["share"] == rows["deep/white.OBJ"]["share"]
    assert 0.05 < float(rows["lost.obj"]["share"]) < 0.9
    assert "no camera is given" in rows["tetrahedron.obj"]["notes"]
    with Image.open(tmp_path / "out/sheet.png") as sheet:
        assert sheet.size == (4 * (48 + 4), 48 + obj_sheet.LABEL_HEIGHT + 4)


def test_a_camera_of_the_sidecar_is_the_silhouettes(
    nst_binary: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, z in (("near", 4.0), ("far", 40.0)):
        (tmp_path / f"{name}.obj").write_text(TETRAHEDRON)
        (tmp_path / f"{name}.toml").write_text(
            f"[camera]\nposition = [0.0, 0.0, {z}]\ntarget = [0.0, 0.0, 0.0]\nvertical_fov = 40.0\n"
        )
    rows = run(monkeypatch, nst_binary, tmp_path)
    assert float(rows["near.obj"]["share"]) > 10 * float(rows["far.obj"]["share"]) > 0


def test_a_picture_that_takes_too_long(
    nst_binary: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "tetrahedron.obj").write_text(TETRAHEDRON)
    row = run(monkeypatch, nst_binary, tmp_path, "--spp", "100000000", "--timeout", "0.5")["tetrahedron.obj"]
    assert (row["flags"], row["share"]) == ("timeout", "")


def test_a_panic_is_told_from_a_refusal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "x.obj").write_text(TETRAHEDRON)
    fake = tmp_path / "fake"
    fake.write_text("#!/bin/sh\necho thread main panicked >&2\nexit 101\n")
    fake.chmod(0o755)
    row = run(monkeypatch, fake, tmp_path)["x.obj"]
    assert (row["flags"], row["error"]) == ("panic", "thread main panicked")


def test_a_folder_without_obj_files_is_refused(
    nst_binary: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit, match="2"):
        run(monkeypatch, nst_binary, tmp_path)
    assert "contains no OBJ file" in capsys.readouterr().err
