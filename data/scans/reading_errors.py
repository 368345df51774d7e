"""Why a scan cannot be read."""

from data.common.errors import UserError


class UnreadableScanError(Exception):
    """A scan that cannot be read; the text is the reason."""


class EndOfScansError(Exception):
    """There are no more scans."""


class MissingReaderError(UserError):
    """A library is not installed that reads the format."""
