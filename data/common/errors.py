"""The exception for a user's mistake, printed as one line with exit code 2, and those of readers of scans; what others'
exceptions say, in a line."""


class UserError(Exception):
    """A mistake of the user: what is wrong, where, and what to do, in one line. Commands print it and exit with 2."""


class UnreadableScanError(Exception):
    """A scan that cannot be read; the text is the reason."""


class EndOfScansError(Exception):
    """There are no more scans."""


class MissingReaderError(UserError):
    """The library that reads the format is not installed."""


def reason(error: BaseException) -> str:
    """What a library says of bytes that it cannot read, in a line."""
    first = (str(error).splitlines() or [""])[0][:120]
    return f"{type(error).__name__}: {first}" if first else type(error).__name__
