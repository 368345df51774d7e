"""Atomic files, written completely or not at all; users' JSON and text files; the order of files by their names; the
user's cache."""

import csv
import io
import json
import os
import re
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

from data.common.errors import UserError

T = TypeVar("T")


def user_cache() -> Path:
    """The folder `sgslam` in the user's cache directory. Raises RuntimeError for a user without a home."""
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches" / "sgslam"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "sgslam"


@contextmanager
def atomic_file(path: Path | str) -> Iterator[BinaryIO]:
    """Yields a temporary file beside `path` that is renamed to it at the end, so that readers never see a partial file.

    If writing fails, the previous content of `path` stays.
    """
    path = Path(path)
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            yield file
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException as error:
        os.unlink(temporary)
        if isinstance(error, OSError) and error.filename is None:
            error.filename = str(path)
        raise


def write_atomically(path: Path | str, content: str | bytes) -> None:
    """Writes `content` as `atomic_file` does."""
    with atomic_file(path) as file:
        file.write(content.encode() if isinstance(content, str) else content)


def write_json(path: Path | str, value: Any) -> None:
    """Writes strict JSON (no NaN) atomically."""
    write_atomically(path, json.dumps(value, indent=1, allow_nan=False) + "\n")


def write_csv(path: Path | str, rows: Iterable[Iterable[Any]]) -> None:
    """Writes a table, whose first row is its head, atomically."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    write_atomically(path, text.getvalue())


def natural_key(name: str) -> tuple[tuple[int, int, str], ...]:
    """Sorts `2.pcd` before `10.pcd`: runs of digits compare as numbers, and the rest as text."""
    parts = re.findall(r"\d+|\D+", name)
    return tuple((0, int(p), p) if p[0] in "0123456789" else (1, 0, p) for p in parts)


def text_lines(path: Path, wanted: str) -> list[str]:
    """The lines of a text file. Raises UserError, which asks for what is `wanted`, where it cannot be read."""
    try:
        return path.read_text().splitlines()
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror}); give {wanted}") from None
    except UnicodeDecodeError:
        raise UserError(f"{path}: not text; give {wanted}") from None


def parsed_lines(path: Path | str, wanted: str, parse: Callable[[str], T]) -> list[T]:
    """What `parse` makes of each line, without `#` comments and blank lines, of which there is at least one.

    Raises UserError as `text_lines` does, where there is none, and with the line's number where `parse` raises
    ValueError.
    """
    found = []
    for number, line in enumerate(text_lines(Path(path), wanted), 1):
        if text := line.partition("#")[0].strip():
            try:
                found.append(parse(text))
            except ValueError as error:
                raise UserError(f"{path}, line {number}: {error}; give {wanted}") from None
    if not found:
        raise UserError(f"{path}: nothing in it; give {wanted}")
    return found


def read_json(path: Path | str, wanted: str) -> Any:
    """Returns the file's value. Raises UserError if it cannot be read or is not JSON; `wanted` says what to give
    instead.
    """
    try:
        return json.loads(Path(path).read_bytes())
    except OSError as error:
        raise UserError(f"{path}: cannot be read ({error.strerror}); give {wanted}") from None
    except (ValueError, RecursionError):  # ValueError covers bad encodings and numbers of thousands of digits
        raise UserError(f"{path}: not JSON; give {wanted}") from None
