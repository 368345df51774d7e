"""Rows of a study in a file: a line of JSON for each case, written as soon as it is computed."""

import gzip
import json
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from data.common.errors import UserError
from data.common.files import write_atomically
from evaluation.harness.provenance import Provenance
from evaluation.harness.study import key_of

LARGE = 300_000  # bytes, from which a finished file is compressed


@dataclass(frozen=True)
class Row:
    """A case, its record, and where it comes from, as JSON values."""

    case: dict[str, Any]
    record: dict[str, Any]
    made: Provenance

    @property
    def key(self) -> str:
        """The identity of the case."""
        return key_of(self.case)

    def line(self) -> bytes:
        """The row as a line of JSON."""
        value = {"case": self.case, "record": self.record, "made": self.made.model_dump()}
        return (json.dumps(value, separators=(",", ":"), allow_nan=False, ensure_ascii=False) + "\n").encode()


class Append(Protocol):
    """Adds one row to a file."""

    def __call__(self, row: Row) -> None:
        """Writes the row at once."""


def rows_path(folder: Path, name: str) -> Path:
    """The file of a study's rows; `finish` may have added the suffix `.gz`."""
    return folder / f"{name}.jsonl"


def read_rows(path: Path) -> list[Row]:
    """All rows of a file and of its compressed form, the last one of each case. An incomplete last line is ignored.

    Raises UserError for an invalid line.
    """
    rows: dict[str, Row] = {}
    for file in (_compressed(path), path):
        if not file.exists():
            continue
        content = gzip.decompress(file.read_bytes()) if file.suffix == ".gz" else file.read_bytes()
        for number, line in enumerate(content.split(b"\n")[:-1], 1):
            try:
                value = json.loads(line)
                row = Row(value["case"], value["record"], Provenance(**value["made"]))
            except (ValueError, KeyError, TypeError):
                raise UserError(f"{file}:{number}: not a row of a study; delete the line") from None
            rows[row.key] = row
    return list(rows.values())


@contextmanager
def appending(path: Path) -> Iterator[Append]:
    """Opens the file for appending rows; an incomplete last line is removed first."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("ab+") as file:
        file.seek(0)
        file.truncate(file.read().rfind(b"\n") + 1)

        def append(row: Row) -> None:
            file.write(row.line())
            file.flush()
            os.fsync(file.fileno())

        yield append


def finish(path: Path, rows: Iterable[Row]) -> Path:
    """Writes the rows in order of their cases, compressed if they are large; returns the file."""
    content = b"".join(row.line() for row in rows)
    large = len(content) > LARGE
    target, other = (_compressed(path), path) if large else (path, _compressed(path))
    write_atomically(target, gzip.compress(content, mtime=0) if large else content)
    other.unlink(missing_ok=True)
    return target


def _compressed(path: Path) -> Path:
    return path.with_name(path.name + ".gz")
