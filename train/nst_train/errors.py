"""The error that reaches the user as one line, without a traceback."""


class UserError(Exception):
    """Says what is wrong, in which file or key, and what to do about it."""
