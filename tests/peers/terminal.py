#!/usr/bin/env python3
"""Records what a program shows on a terminal.

    python tests/peers/terminal.py [--columns 80] PROGRAM ARGUMENT…

prints the terminal's changing line and what stays, each with its time in seconds.
"""

import argparse
import fcntl
import os
import pty
import re
import struct
import sys
import termios
import time
from dataclasses import dataclass

ROWS = 24
# A carriage return and "erase the line", which begin a new state of the changing line.
NEW_STATE = re.compile("\r\x1b\\[2K|\r\n")
ESCAPE = re.compile("\x1b\\[[0-9;?]*[A-Za-z]")


@dataclass
class Recording:
    """What a program wrote, `(seconds, text)`, and how it ended."""

    written: list[tuple[float, str]]
    exit_code: int

    def lines(self) -> list[tuple[float, str]]:
        """The states of all lines, in order, without empty ones."""
        states = []
        for seconds, text in self.written:
            shown = (ESCAPE.sub("", state) for state in NEW_STATE.split(text))
            states.extend((seconds, state) for state in shown if state.strip())
        return states


def record(command: list[str], columns: int) -> Recording:
    """Runs a program on a terminal of so many columns."""
    process, terminal = pty.fork()
    if process == 0:
        fcntl.ioctl(0, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, columns, 0, 0))
        os.environ["TERM"] = "xterm"
        os.execvp(command[0], command)
    begin = time.monotonic()
    written = []
    while True:
        try:
            data = os.read(terminal, 1 << 16)
        except OSError:  # Linux says so at the end.
            break
        if not data:
            break
        written.append((time.monotonic() - begin, data.decode(errors="replace")))
    os.close(terminal)
    _, status = os.waitpid(process, 0)
    return Recording(written, os.waitstatus_to_exitcode(status))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--columns", type=int, default=80)
    parser.add_argument("command", nargs=argparse.REMAINDER)
    args = parser.parse_args()
    recording = record(args.command, args.columns)
    for seconds, line in recording.lines():
        print(f"{seconds:7.2f}  {line}")
    sys.exit(recording.exit_code)


if __name__ == "__main__":
    main()
