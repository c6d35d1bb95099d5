"""Runs the `nst` binary."""

import os
import subprocess
from pathlib import Path

from nst_train.errors import UserError

REPOSITORY = Path(__file__).resolve().parents[2]


def renderer() -> Path:
    """The `nst` binary: the environment variable NST, or the release build of this repository."""
    path = Path(os.environ.get("NST") or REPOSITORY / "target" / "release" / "nst")
    if not path.is_file():
        raise UserError(
            f"{path}: no such renderer; build it with `cargo build --release` in {REPOSITORY}, "
            "or set the environment variable NST to an nst binary"
        )
    return path


def run(*words: object) -> None:
    """`nst WORDS --quiet`, which must end well."""
    command = [str(word) for word in (renderer(), *words, "--quiet")]
    try:
        result = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
    except OSError as error:
        raise UserError(f"{command[0]}: cannot run the renderer: {error.strerror}") from error
    if result.returncode != 0:
        said = " ".join(result.stderr.split()) or "it said nothing"
        raise UserError(f"nst {' '.join(command[1:4])} failed ({result.returncode}): {said}")
