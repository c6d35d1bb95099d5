"""A stand-in for the renderer, and data to ask it for."""

import sys
from pathlib import Path

import pytest

from nst_train.config import RendersData

WIDTH, HEIGHT = 5, 3


@pytest.fixture
def fake_nst(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Makes fake_nst.py the renderer; returns the log of its calls."""
    binary, log = tmp_path / "nst", tmp_path / "calls"
    script = Path(__file__).with_name("fake_nst.py")
    binary.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{script}" "$@"\n')
    binary.chmod(0o755)
    monkeypatch.setenv("NST", str(binary))
    monkeypatch.setenv("FAKE_NST_LOG", str(log))
    return log


@pytest.fixture
def settings(tmp_path: Path) -> RendersData:
    scene = tmp_path / "scene" / "box.obj"
    scene.parent.mkdir()
    scene.write_text("v 0 0 0\n")
    return RendersData(
        kind="renders",
        scene=str(scene),  # an absolute path stays what it is
        size=[WIDTH, HEIGHT],
        runs=2,
        evaluation_runs=1,
        terms=10,
        reference_spp=500,
        first_seed=5,
        sampler="random",
        max_depth=2,
        pixel="center",
    )
