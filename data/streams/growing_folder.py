"""The scans of a folder that a recorder fills while we read it."""

import os
import time
from collections.abc import Iterator
from pathlib import Path

from data.common.errors import UnreadableScanError, UserError
from data.common.files import natural_key
from data.scans.formats import READERS, read_timed
from data.scans.scan import finished
from data.streams.arrivals import Arrival, ScanStream
from data.trajectory.stamps import NOTE_INDICES, SCAN_PERIOD_NS, ns_to_seconds, seconds_to_ns, stamp_in_name

_SETTLED = 1.0  # s after its last change from which a file is complete,
_LEFT = 0.1  # and so soon where a later one is there: its writer has gone on
_WAIT = 0.05  # s until the folder is listed again


class GrowingFolder(ScanStream):
    """Takes each scan file once it is complete: it has not changed for a second, or for a tenth of one where the next
    file is there.

    Scans are taken in the natural order of their names; one that comes after a later one is skipped. Names that begin
    with a dot are left alone.
    """

    def __init__(self, path: Path | str) -> None:
        """Raises UserError if there is no such folder."""
        super().__init__(Path(path))
        if not self.path.is_dir():
            what = "is a file" if self.path.exists() else "does not exist"
            raise UserError(f"{self.path}: {what}; give the folder into which scans are written")
        self._stamps = GrowingStamps(self.path)
        self._known = set[str]()  # names of files that were taken or skipped
        self._last: Path | None = None
        self._index = 0

    def _arrivals(self) -> Iterator[Arrival]:
        while not self.stop.wait(_WAIT):
            new = set(os.listdir(self.path)) - self._known
            files = sorted((self.path / name for name in new if _is_scan(name)), key=_order)
            for file in files:
                is_left = file is not files[-1]
                stamp_ns = self._stamps.stamp_ns(self._index, file) if _is_complete(file, is_left) else None
                if stamp_ns is None or self.stop.is_set():  # those after it wait for it
                    break
                yield from self._read(file, stamp_ns, time.perf_counter())

    def _read(self, file: Path, stamp_ns: int, came_s: float) -> Iterator[Arrival]:
        self._known.add(file.name)
        index, last = self._index, self._last
        self._index += 1
        if last is not None and file.suffix.lower() != last.suffix.lower():
            self._skip(index, file, f"it is not a {last.suffix} file, unlike those before")
            return
        if last is not None and _order(file) < _order(last):
            self._skip(index, file, f"it came after {last.name}")
            return
        self._last = file
        if self._stamps.are_guessed and NOTE_INDICES not in self.remarks:
            self.remarks.append(NOTE_INDICES)
        try:
            points, times = read_timed(file)
            yield Arrival(finished(index, stamp_ns, points, times, file, stamped=self.stamped), came_s)
        except UnreadableScanError as error:
            self._skip(index, file, f"{error} (stamp {ns_to_seconds(stamp_ns)} s)")


def _is_scan(name: str) -> bool:
    return not name.startswith(".") and Path(name).suffix.lower() in READERS


def _is_complete(file: Path, is_left: bool) -> bool:
    try:
        about = file.stat()
    except FileNotFoundError:  # gone; reading it will say so
        return True
    return about.st_size > 0 and time.time() - about.st_mtime > (_LEFT if is_left else _SETTLED)


def _order(file: Path) -> tuple[tuple[int, int, str], ...]:
    return natural_key(file.name)


class GrowingStamps:
    """The stamps of a folder's scans, by the same rules as those of a folder that is complete: a times.txt in it or
    beside it, which must be there before the first scan and to which lines may be added; else stamps in the files'
    names; else 0.1 s between scans.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._times: Path | None = None
        self._read, self._lines, self._stamps = 0, 0, list[int]()  # bytes and lines of times.txt so far
        self._in_names: bool | None = None  # None before the first scan

    @property
    def are_guessed(self) -> bool:
        """Whether neither times.txt nor the names give stamps, once the first scan has shown it."""
        return self._times is None and self._in_names is False

    def stamp_ns(self, index: int, file: Path) -> int | None:
        """The stamp of a scan; None while its line in times.txt is not complete. Raises UserError where it is wrong or
        missing."""
        if self._in_names is None:
            beside = (self._folder / "times.txt", self._folder.resolve().parent / "times.txt")
            self._times = next((times for times in beside if times.is_file()), None)
            self._in_names = self._times is None and _named(file) is not None
        if self._times is not None:
            if index >= len(self._stamps):
                self._read_on(self._times)
            return self._stamps[index] if index < len(self._stamps) else None
        stamp = _named(file)
        if (stamp is not None) != self._in_names:
            raise UserError(
                f"{file}: its name carries {'a' if stamp is not None else 'no'} stamp, unlike those before; give every "
                "scan a stamp, or write times.txt"
            )
        return index * SCAN_PERIOD_NS if stamp is None else stamp

    def _read_on(self, times: Path) -> None:
        """Reads the lines that were added: one float second a line; blank lines and `#` comments are skipped."""
        with times.open("rb") as file:
            file.seek(self._read)
            whole, newline, _ = file.read().rpartition(b"\n")
        self._read += len(whole) + len(newline)
        for line in whole.split(b"\n") if newline else []:
            self._lines += 1
            if not (text := line.decode(errors="replace").partition("#")[0].strip()):
                continue
            try:
                self._stamps.append(seconds_to_ns(text))
            except ValueError as error:
                raise UserError(f"{times}, line {self._lines}: {error}; give one stamp (s) per line") from None


def _named(file: Path) -> int | None:
    try:
        return stamp_in_name(file.stem)
    except ValueError as error:
        raise UserError(f"{file}: {error}; rename it, or give times.txt") from None
