"""The exception for a user's mistake: printed as one line, exit code 2."""


class UserError(Exception):
    """What is wrong, where, and what to do, in one line. Commands print it and exit with 2."""
