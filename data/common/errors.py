"""The exception for a user's mistake: printed as one line, exit code 2."""


class UserError(Exception):
    """A mistake of the user: what is wrong, where, and what to do, in one line. Commands print it and exit with 2."""
