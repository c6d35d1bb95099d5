"""What the tests against other programs share: the `nst` binary, and both Python readers of EXR."""

import os
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

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
