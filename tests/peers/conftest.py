"""What the tests against other programs share: the `nst` binary, and both Python readers of EXR."""

import os
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from browser import Browser

REPOSITORY = Path(__file__).resolve().parents[2]

Nst = Callable[..., str]


@pytest.fixture(scope="session")
def nst_binary() -> Path:
    """The binary that the environment variable NST names, or the debug build."""
    binary = Path(os.environ.get("NST", REPOSITORY / "target" / "debug" / "nst"))
    if not binary.is_file():
        pytest.fail(f"{binary} is missing: cargo build -p nst-cli")
    return binary


@pytest.fixture
def nst(nst_binary: Path, tmp_path: Path) -> Nst:
    """Runs `nst` in the test's folder; returns what it says."""

    def run(*arguments: object) -> str:
        command = [nst_binary, *map(str, arguments)]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{command}: {done.stderr}"
        return done.stdout

    return run


@pytest.fixture(scope="session")
def browser() -> Iterator["Browser"]:
    from browser import Browser  # Other tests need neither Selenium nor Chromium.

    browser = Browser()
    yield browser
    browser.quit()


@pytest.fixture
def page(browser: "Browser", nst: Nst, tmp_path: Path) -> Iterator["Browser"]:
    """The report of `report_film`'s table, with a picture by another program, opened as a file. It must
    ask for no other file, and log nothing."""
    from report_film import FILM, settle, write_table

    write_table(tmp_path / "results.csv")
    FILM.write_exr(tmp_path / "results.exr")
    nst("report", "results.csv", "--picture", f"other <u>={tmp_path}/results.exr:auto.32")
    browser.resize(1280)
    browser.prefer("light")
    browser.open(tmp_path / "results.html")
    settle(browser)
    browser.center("#stage")
    yield browser
    assert browser.console() == []
    assert browser.requests() == [(tmp_path / "results.html").as_uri()]
