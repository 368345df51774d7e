"""The one exception that stands for a mistake of the user's: told in one line, exit code 2."""


class UserError(Exception):
    """What is wrong, where, and what to do, in one line; commands print it and exit with 2."""
