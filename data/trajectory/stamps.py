"""Time stamps: decimal seconds in text to int64 nanoseconds and back, without passing through floats."""

import re
from collections.abc import Sequence
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np

from data.common.errors import UserError
from data.common.files import parsed_lines

NS = 1_000_000_000
SCAN_PERIOD_NS = NS // 10
NOTE_INDICES = "the scans have no stamps; they are assumed to be 0.1 s apart"
_INT64 = np.iinfo(np.int64)
_DIGITS = {13: "milliseconds", 16: "microseconds", 19: "nanoseconds"}  # of times since 1970
_SECONDS_IN_NAME = re.compile(r"\D*?(-?\d+\.\d+)")
_NANOSECONDS_IN_NAME = re.compile(r"\D*(\d{16,})")


def seconds_to_ns(text: str) -> int:
    """Nanoseconds of decimal seconds such as `1700000000.123456789` or `1.03e-01`, exact to the nanosecond.

    Raises ValueError where the text is no finite number or the nanoseconds do not fit int64.
    """
    try:
        seconds = Decimal(text)
    except InvalidOperation:
        raise ValueError(f"'{text}' is not a number") from None
    if not seconds.is_finite() or seconds.adjusted() > 11:
        unit = _DIGITS.get(seconds.adjusted() + 1)
        raise ValueError(f"'{text}' is not a stamp in seconds{f', but seems to be in {unit}' if unit else ''}")
    nanoseconds = int((seconds * NS).to_integral_value())
    if not _INT64.min <= nanoseconds <= _INT64.max:
        raise ValueError(f"'{text}' is not a stamp in seconds")
    return nanoseconds


def ns_to_seconds(stamp_ns: int) -> str:
    """Decimal seconds with nine places: `seconds_to_ns` of it is `stamp_ns` again."""
    seconds, nanoseconds = divmod(abs(int(stamp_ns)), NS)
    return f"{'-' if stamp_ns < 0 else ''}{seconds}.{nanoseconds:09d}"


def stamp_in_name(stem: str) -> int | None:
    """The stamp (ns) in a scan's name: seconds with a decimal point, or at least 16 digits of ns.

    A prefix without digits is allowed (`scan_1700000000.25`); None if there is no stamp.
    """
    if match := _SECONDS_IN_NAME.fullmatch(stem):
        return seconds_to_ns(match[1].lstrip("-") if match.start(1) > 0 else match[1])
    match = _NANOSECONDS_IN_NAME.fullmatch(stem)
    if match and int(match[1]) > _INT64.max:
        raise ValueError(f"'{match[1]}' is too large for a stamp in nanoseconds")
    return int(match[1]) if match else None


def stamp_of(file: Path) -> int | None:
    """The stamp in a scan's name, as `stamp_in_name`. Raises UserError where it cannot be one."""
    try:
        return stamp_in_name(file.stem)
    except ValueError as error:
        raise UserError(f"{file}: {error}; rename it, or give times.txt") from None


def stamps_from_names(files: Sequence[Path]) -> list[int] | None:
    """The stamps (ns) in the files' names, or None where no name carries one.

    Raises UserError where only some names do.
    """
    stamps = [stamp_of(file) for file in files]
    known = {file: stamp for file, stamp in zip(files, stamps, strict=True) if stamp is not None}
    if known and len(known) < len(stamps):
        file, other = next(iter(known)), next(file for file in files if file not in known)
        raise UserError(
            f"{file.parent}: the name '{file.name}' carries a stamp and '{other.name}' does not; give every scan a "
            "stamp, or write times.txt"
        )
    return list(known.values()) or None


def times_of(folder: Path) -> Path | None:
    """The `times.txt` of a folder of scans, in it or beside it."""
    return next((t for t in (folder / "times.txt", folder.resolve().parent / "times.txt") if t.is_file()), None)


def read_times(path: Path) -> list[int]:
    """Reads stamps (ns) from a file with one float second per line; blank lines and `#` comments are skipped."""
    return parsed_lines(path, "one stamp per line, in seconds", seconds_to_ns)
