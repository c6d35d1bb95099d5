"""The set for a network that weighs the guard's experts: what is planned, and what is read."""

import json
from collections import Counter
from itertools import pairwise
from pathlib import Path

import numpy as np
import OpenEXR
import pytest

from nst_train.__main__ import main
from nst_train.guard_data import files, make, read
from nst_train.guard_data.plan import HELD_OUT, SCENES, STAGES, STRATA, order, plan
from nst_train.random_scenes import BRANCHES


def test_at_any_time_all_families_are_alike() -> None:
    steps = order()
    assert len(steps) == len(set(steps)) == SCENES * len(STAGES) * len(BRANCHES)
    done: Counter[tuple[str, int]] = Counter()
    seen: dict[str, int] = {}
    for step, stage in steps:
        assert seen.get(step.name, 0) == stage  # stage after stage
        seen[step.name] = stage + 1
        done[step.family, stage] += 1
        for k in range(len(STAGES)):
            counts = [done[family, k] for family in BRANCHES]
            assert max(counts) - min(counts) <= 1
    assert set(HELD_OUT) <= set(BRANCHES)
    training = {step.name for step, _ in steps if not step.held_out}
    assert len(training) >= 120


def test_a_plan_follows_from_its_name_and_plans_differ() -> None:
    assert plan("glass", 3) == plan("glass", 3)
    plans = [plan(family, index) for family in BRANCHES for index in range(SCENES)]
    for pick, first, share in (
        (lambda p: p.sampler, "random", 0.7),
        (lambda p: p.pixel, "box", 0.7),
        (lambda p: p.counts[0], 8, 0.65),
        (lambda p: p.counts[3], 1024, 0.65),
    ):
        found = np.mean([pick(p) == first for p in plans])
        assert abs(found - share) < 4 * np.sqrt(share * (1 - share) / len(plans))
    assert all(count in pair for p in plans for count, pair in zip(p.counts, STRATA, strict=True))


def test_no_two_renderings_of_a_scene_share_a_seed() -> None:
    for p in (plan("room", 0), plan("water", 4)):
        pieces = range(4096 // make.PIECE)
        seeds = [p.seed_of_piece(half, piece) for half in (0, 1) for piece in pieces]
        seeds += [p.seed_of_sequence(spp) for spp in p.possible()]
        assert len(set(seeds)) == len(seeds) and min(seeds) >= 0 and max(seeds) < 2**32


def test_what_takes_long_gets_fewer_samples() -> None:
    p = next(p for p, _ in order() if p.counts == (8, 32, 128, 1024))
    assert make.affordable(p, 0, 1e9) == ([8, 32, 128], 512)
    assert make.affordable(p, 1, 1e9) == ([8, 32, 128, 1024], 1024)
    assert make.affordable(p, 2, 1e9) == ([8, 32, 128, 1024], 2048)
    assert make.affordable(p, 0, 700) == ([8, 32, 128], 256)
    assert make.affordable(p, 0, 1) == ([8, 32, 128], 128)
    assert make.affordable(p, 2, 3300) == ([8, 32, 128, 1024], 1024)
    assert make.affordable(p, 1, 2000) == ([8, 32, 128, 512], 512)
    assert make.affordable(p, 1, 1)[0] == [8, 32, 128]
    for spp in np.geomspace(1, 1e5, 100):
        stages = [make.affordable(p, stage, spp) for stage in range(len(STAGES))]
        for (before, less), (counts, reference) in pairwise(stages):
            assert reference >= max(counts) and set(counts) <= set(p.possible())
            assert reference >= less and counts[: len(before)] == before
        assert stages[1][0] == stages[2][0]


def test_a_stage_is_made_once_and_a_failure_does_not_end_the_rest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def made(plan, stage, folder, size, budget):
        asked.append((plan.name, stage))
        if plan.name == "plane-001":
            raise make.UserError("it rains")
        return True

    monkeypatch.setattr(make, "make_stage", made)
    said: list[str] = []
    with pytest.raises(make.UserError, match="3 stages failed, of plane-001"):
        make.make(tmp_path, ["plane", "fence-002"], say=said.append)
    assert len(asked) == len(said) == len(STAGES) * (SCENES + 1)
    assert {name for name, _ in asked} == {*(f"plane-{i:03}" for i in range(SCENES)), "fence-002"}
    assert sum("it rains" in line for line in said) == len(STAGES)


def test_an_unknown_name_is_an_error(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["guard-data", "--folder", str(tmp_path), "--only", "plane", "teapot"]) == 1
    assert "no family or scene is called teapot" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_only_what_is_complete_is_read(tmp_path: Path) -> None:
    radiance = np.arange(24.0).reshape(2, 4, 3)
    facts = {"family": "maze", "held_out": True, "counts": [8, 128]}
    for name in ("maze-000", "maze-001", "maze-002", "tuning-pool"):
        (tmp_path / name).mkdir()
        for half in (0, 1):
            if (name, half) != ("maze-002", 1):
                files.write_reference(
                    tmp_path / name / f"reference-{half}.exr", radiance + half, 512 * (half + 1)
                )
        for spp in (128, 8, 32):
            files.write_reference(tmp_path / name / f"{spp}-0.exr", radiance, spp)
    for name in ("maze-000", "maze-002"):
        (tmp_path / name / "scene.json").write_text(json.dumps(facts))
    (tmp_path / "make.log").write_text("")
    found = list(read.pictures(tmp_path))
    assert [(p.scene, p.spp) for p in found] == [
        *(("maze-000", 8), ("maze-000", 128)),
        *(("tuning-pool", 8), ("tuning-pool", 32), ("tuning-pool", 128)),
    ]
    assert [(p.family, p.held_out) for p in found[1:3]] == [("maze", True), ("tuning-pool", False)]
    assert all(p.reference_spp == 512 and p.sequence.is_file() for p in found)
    np.testing.assert_array_equal(found[0].halves(), [radiance, radiance + 1])


def test_a_shortened_sequence_has_the_last_term_and_no_state(tmp_path: Path) -> None:
    pixels = np.ones((2, 3), np.float32)
    names = ["R", "S0007.R", "S0008.R", "Skipped.Y", "fold0.R", "albedo2.R", "Variance.R"]
    channels = {name: pixels * (i + 1) for i, name in enumerate(names)}
    state = {"state.fold0.hi.R": pixels.astype(np.uint32)}
    header = {"type": OpenEXR.scanlineimage, "compression": OpenEXR.ZIP_COMPRESSION}
    told = {"nst.version": "1", "nst.terms": "7,8", "nst.keep": "window 8", "samplesPerPixel": 8}
    whole, short = tmp_path / "whole.exr", tmp_path / "short.exr"
    OpenEXR.File({**header, **told}, channels | state).write(str(whole))
    files.shorten(whole, short)
    with OpenEXR.File(str(short), separate_channels=True) as file:
        found = {name: channel.pixels for name, channel in file.channels().items()}
        assert file.header()["nst.terms"] == "8" and file.header()["nst.version"] == "1"
        assert "nst.keep" not in file.header()
    del channels["S0007.R"]
    assert set(found) == set(channels)
    assert all(np.array_equal(found[name], channels[name]) for name in channels)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["short.exr", "whole.exr"]
