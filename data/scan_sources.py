"""Scans of whatever the user has: a folder of scans."""

from pathlib import Path

from data.errors import UserError
from data.scans import ScanFolder, ScanSource


def open_scans(path: Path | str, topic: str | None = None) -> ScanSource:
    """The scans of a folder.

    Raises UserError where there are none, and where a `topic` is named for what has no topics.
    """
    path = Path(path)
    if topic is not None:
        raise UserError(f"--topic {topic}: {path} is no bag and has no topics")
    return ScanFolder(path)
