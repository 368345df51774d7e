"""Exceptions of scan readers."""

from data.common.errors import UserError


class UnreadableScanError(Exception):
    """A scan that cannot be read; the text is the reason."""


class EndOfScansError(Exception):
    """There are no more scans."""


class MissingReaderError(UserError):
    """The library that reads the format is not installed."""
