"""Runs `nst` for the measurements in this folder."""

import json
import os
import subprocess
import sys
from pathlib import Path


def run(command: list[object], folder: Path | str | None = None) -> dict:
    """Runs a command of nst in a folder: what it says with `--json`, and beside that `user_seconds` and
    `peak_mebibytes`, the most memory that the process had. Exits if it fails.
    """
    words = [*map(str, command), "--json"]
    with subprocess.Popen(words, cwd=folder, stdout=subprocess.PIPE) as process:
        said = process.stdout.read()
        # Not `wait`, which does not tell the resources.
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        sys.exit(f"{' '.join(words)} failed")
    return json.loads(said) | {"user_seconds": usage.ru_utime, "peak_mebibytes": usage.ru_maxrss / 1024}
