"""The rows of a measurement in a CSV file, written after each row, so that it can be interrupted and repeated."""

import csv
import io
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from data.common.errors import UserError
from data.common.files import write_atomically

Record = dict[str, str]  # a row as the file has it; empty for None


class RecordFile:
    """A CSV file with rows of one dataclass; existing rows are read at once."""

    def __init__(self, path: Path, row: type) -> None:
        """Raises UserError for a file with other columns."""
        self._path, self._columns = path, tuple(f.name for f in fields(row))
        self.records = read_records(path, self._columns)

    def find(self, **values: Any) -> Record | None:
        """The first row with these values; None if there is none."""
        wanted = {name: str(value) for name, value in values.items()}
        return next((r for r in self.records if wanted.items() <= r.items()), None)

    def add(self, row: Any) -> Record:
        """Adds a row, an instance of the dataclass, and writes the file."""
        record = {name: "" if value is None else str(value) for name, value in asdict(row).items()}
        self.records.append(record)
        self._path.parent.mkdir(parents=True, exist_ok=True)
        write_records(self._path, self._columns, self.records)
        return record


def read_records(path: Path, columns: tuple[str, ...]) -> list[Record]:
    """The rows of a file; empty without a file. Raises UserError for a file with other columns."""
    if not path.exists():
        return []
    with path.open(newline="") as file:
        records = list(csv.DictReader(file))
    if records and tuple(records[0]) != columns:
        raise UserError(f"{path}: has other columns than this version writes; give another --out")
    return records


def write_records(path: Path, columns: tuple[str, ...], records: list[Record]) -> None:
    """Writes the rows atomically."""
    text = io.StringIO()
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    writer.writerows(records)
    write_atomically(path, text.getvalue())
