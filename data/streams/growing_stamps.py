"""Stamps of scans whose files are still coming: from a times.txt that grows, or from their names."""

from pathlib import Path

from data.common.errors import UserError
from data.trajectory.stamps import SCAN_PERIOD_NS, seconds_to_ns, stamp_in_name


class GrowingTimes:
    """A times.txt to which lines are added: one float second a line; blank lines and `#` comments are skipped."""

    def __init__(self, path: Path) -> None:
        self._path, self._read, self._lines = path, 0, 0
        self._stamps: list[int] = []

    def stamp_ns(self, index: int) -> int | None:
        """The stamp of the scan with this index; None while its line is not complete. Raises UserError."""
        if index >= len(self._stamps):
            self._read_on()
        return self._stamps[index] if index < len(self._stamps) else None

    def _read_on(self) -> None:
        with self._path.open("rb") as file:
            file.seek(self._read)
            whole, newline, _ = file.read().rpartition(b"\n")
        self._read += len(whole) + len(newline)
        for line in whole.split(b"\n") if newline else []:
            self._lines += 1
            text = line.decode(errors="replace").partition("#")[0].strip()
            if not text:
                continue
            try:
                self._stamps.append(seconds_to_ns(text))
            except ValueError as error:
                raise UserError(f"{self._path}, line {self._lines}: {error}; give one stamp (s) per line") from None


class GrowingStamps:
    """The stamps of a folder's scans, by the same rules as those of a folder that is complete: a times.txt in it or
    beside it, which must be there before the first scan; else stamps in the files' names; else 0.1 s between scans.

    `are_guessed` once the first scan has shown that they are taken to be 0.1 s apart.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._times: GrowingTimes | None = None
        self._in_names: bool | None = None  # None before the first scan

    @property
    def are_guessed(self) -> bool:
        """Whether neither times.txt nor the names give stamps."""
        return self._times is None and self._in_names is False

    def stamp_ns(self, index: int, file: Path) -> int | None:
        """The stamp of a scan; None while it is not known yet. Raises UserError where it is wrong or missing."""
        if self._in_names is None:
            self._begin(file)
        if self._times is not None:
            return self._times.stamp_ns(index)
        stamp = _named(file)
        if (stamp is not None) != self._in_names:
            raise UserError(
                f"{file}: its name carries {'a' if stamp is not None else 'no'} stamp, unlike those before; give every "
                "scan a stamp, or write times.txt"
            )
        return index * SCAN_PERIOD_NS if stamp is None else stamp

    def _begin(self, first: Path) -> None:
        for times in (self._folder / "times.txt", self._folder.resolve().parent / "times.txt"):
            if times.is_file():
                self._times = GrowingTimes(times)
                break
        self._in_names = self._times is None and _named(first) is not None


def _named(file: Path) -> int | None:
    try:
        return stamp_in_name(file.stem)
    except ValueError as error:
        raise UserError(f"{file}: {error}; rename it, or give times.txt") from None
