"""Rows of a study in a file: a line of JSON for each case, with where it comes from."""

import gzip
import json
import os
import platform
import re
import subprocess
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict

from data.common.build import content_hash
from data.common.errors import UserError
from data.common.files import write_atomically
from evaluation.study import Record, key_of

ROOT = Path(__file__).resolve().parents[1]
LARGE = 300_000  # bytes, from which a finished file is compressed
FAILED = "failed"  # the status of a case whose measurement raised an error


class Provenance(BaseModel):
    """`build` is a hash of all files of the packages that the study depends on; `commit` that of the checkout, empty
    without git, with a `+` where files differ from it."""

    model_config = ConfigDict(frozen=True)

    build: str
    commit: str
    command: str
    machine: str
    date: str

    @staticmethod
    def of(command: str, packages: tuple[str, ...]) -> "Provenance":
        """The provenance of a row that this machine computes now."""
        now = datetime.now().isoformat(sep=" ", timespec="minutes")
        return Provenance(build=content_hash(packages), commit=_commit(), command=command, machine=_machine(), date=now)


@dataclass(frozen=True)
class Row:
    """A case, its record, and where it comes from, as JSON values."""

    case: dict[str, Any]
    record: Record
    made: Provenance

    @property
    def key(self) -> str:
        """The identity of the case."""
        return key_of(self.case)

    @property
    def failed(self) -> bool:
        """Whether the measurement raised an error."""
        return self.record.get("status") == FAILED

    def line(self) -> bytes:
        """The row as a line of JSON."""
        value = {"case": self.case, "record": self.record, "made": self.made.model_dump()}
        return (json.dumps(value, separators=(",", ":"), allow_nan=False, ensure_ascii=False) + "\n").encode()


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
def appending(path: Path) -> Iterator[Callable[[Row], None]]:
    """A function that adds a row to the file at once; an incomplete last line is removed first."""
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


def _machine() -> str:
    """The processor and its number of cores."""
    try:
        found = re.search(r"^model name\s*:\s*(.+)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    except OSError:
        found = None
    processor = found.group(1).strip() if found else platform.processor() or platform.machine()
    return f"{processor}, {os.cpu_count()} cores"


def _commit() -> str:
    command = ["git", "-C", str(ROOT), "describe", "--always", "--exclude=*", "--dirty=+", "--abbrev=8"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ""
