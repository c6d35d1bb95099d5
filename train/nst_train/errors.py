"""Errors that reach the user as one line, without a traceback."""

import sys
from collections.abc import Callable


class UserError(Exception):
    """Says what is wrong, in which file or key, and what to do about it."""


def exit_code(work: Callable[[], None]) -> int:
    """Does a command's work, which can be interrupted and continued; 0 if it did all."""
    try:
        work()
    except (UserError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("interrupted; the same command continues from the last checkpoint", file=sys.stderr)
        return 130
    return 0
