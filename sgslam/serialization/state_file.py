"""The state file of a run: a header in JSON and packed parts, written atomically; damaged files are rejected."""

import json
import re
from hashlib import sha256
from pathlib import Path
from typing import Any, BinaryIO

from data import UserError
from data.common.files import atomic_file

VERSION = 25  # to be raised when an attribute of any object in a state gets another name or meaning
_FIRST_LINE = re.compile(rb"sgslam state (\d{1,9}) ([0-9a-f]{64})\n")


def write_state(path: Path, about: dict[str, Any], parts: dict[str, bytes]) -> None:
    """Writes `parts` (see `pack`) by name, with a header `about` them (JSON), atomically. Raises OSError if the file
    cannot be written."""
    lengths = {name: (len(raw), sha256(raw).hexdigest()) for name, raw in parts.items()}
    header = json.dumps({"about": about, "parts": lengths}, allow_nan=False).encode() + b"\n"
    with atomic_file(path) as file:
        file.write(b"sgslam state %d %s\n" % (VERSION, sha256(header).hexdigest().encode()) + header)
        for raw in parts.values():
            file.write(raw)


def read_about(path: Path) -> dict[str, Any]:
    """The header of a state file, without reading the rest. Raises UserError as `read_state` does."""
    with _opened(path) as file:
        about: dict[str, Any] = _header(path, file)["about"]
        return about


def read_state(path: Path) -> tuple[dict[str, Any], dict[str, bytes]]:
    """The header and the parts of a state file.

    Raises UserError, in one line, if the file is missing, of another version, or damaged.
    """
    with _opened(path) as file:
        header, parts = _header(path, file), {}
        for name, (length, digest) in header["parts"].items():
            parts[name] = file.read(length)
            if sha256(parts[name]).hexdigest() != digest:
                raise UserError(f"{path}: damaged; start a new run")
        return header["about"], parts


def _opened(path: Path) -> BinaryIO:
    try:
        return path.open("rb")
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror}); it cannot be resumed") from None


def _header(path: Path, file: BinaryIO) -> dict[str, Any]:
    found = _FIRST_LINE.fullmatch(file.readline(100))
    if found is None:
        raise UserError(f"{path}: not a saved run; it cannot be resumed")
    version, digest = found[1].decode(), found[2].decode()
    if version != str(VERSION):
        raise UserError(f"{path}: saved in version {version} of the format, this is {VERSION}; start a new run")
    raw = file.readline()
    if sha256(raw).hexdigest() != digest:
        raise UserError(f"{path}: damaged; start a new run")
    header: dict[str, Any] = json.loads(raw)
    return header
