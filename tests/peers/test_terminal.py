"""What `nst render` shows on a terminal."""

import re

import pytest

from conftest import REPOSITORY
from terminal import Recording, record

CORNELL = REPOSITORY / "scenes" / "cornell" / "cornell.obj"


def steps(recording: Recording) -> list[str]:
    """The first words of the lines, each once, in order."""
    words = [line.split()[0] for _, line in recording.lines()]
    return list(dict.fromkeys(words))


def check(recording: Recording, columns: int) -> None:
    """Every step is shown, and no line is longer than the terminal."""
    lines = [line for _, line in recording.lines()]
    assert all(len(line) <= columns for line in lines), max(lines, key=len)
    shown = ["reading", "scene", "film", "building", "render", "transforming", "transform"]
    assert [step for step in steps(recording) if step in shown] == shown
    bars = [line for line in lines if line.endswith("left")]
    assert bars and all(re.search(r"\d+ %, (\d+|\?) \w+.* left$", bar) for bar in bars)


@pytest.mark.parametrize("columns", [80, 50])
def test_all_steps_are_shown_on_lines_that_fit(nst_binary, tmp_path, monkeypatch, columns):
    # A path that is longer than the terminal could not be broken.
    monkeypatch.chdir(tmp_path)
    options = ["--spp", "32", "--size", "300x300", "--backend", "cpu"]
    recording = record([str(it) for it in [nst_binary, "render", "--scene", CORNELL, *options]], columns)
    assert recording.exit_code == 0
    check(recording, columns)
    with pytest.raises(AssertionError):
        check(Recording([*recording.written, (9.0, "x" * 81)], 0), columns)
    with pytest.raises(AssertionError):
        check(Recording(recording.written[3:], 0), columns)
    # The changing line is gone at the end: what stays ends with the summary.
    assert recording.lines()[-1][1].startswith("total")


def test_quiet_and_json_show_nothing_else(nst_binary, tmp_path):
    command = [nst_binary, "render", "--scene", CORNELL, "--spp", "1", "--size", "9x9"]
    for option in ["--quiet", "--json"]:
        command_line = [*command, option, "-o", tmp_path / "x.exr"]
        lines = record([str(it) for it in command_line], 80).lines()
        assert len(lines) == (option == "--json")
