"""Scans as they come: a folder that a recorder fills while we read it."""

import os
import threading
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

from data.common.errors import UnreadableScanError, UserError
from data.common.files import natural_key
from data.scans import Scan
from data.scans.formats import is_scan, read_timed
from data.scans.point_times import Stamped, StampRule, TurnTimes
from data.scans.scan import SkippedScan, finished
from data.trajectory.stamps import NOTE_INDICES, SCAN_PERIOD_NS, ns_to_seconds, seconds_to_ns, stamp_of, times_of

_SETTLED = 1.0  # s after its last change from which a file is complete,
_LEFT = 0.1  # and so soon where a later one is there: its writer has gone on
_WAIT = 0.05  # s until the folder is listed again


@dataclass(frozen=True, eq=False)
class Arrival:
    """A scan, and the reading of `time.perf_counter` at which all of it was there, before it was read."""

    scan: Scan
    came_s: float


class GrowingFolder:
    """Takes each scan file once it is complete: it has not changed for a second, or for a tenth of one where the next
    file is there.

    Scans are taken in the natural order of their names; one that comes after a later one is skipped. Names that begin
    with a dot are left alone. `skipped` lists the scans that could not be used, so far; `remarks` are lines on the data
    for the user; `stamped` is the instant of a scan that its stamp names.
    """

    stamped: Stamped = "start"

    def __init__(self, path: Path | str) -> None:
        """Raises UserError if there is no such folder."""
        self._path = Path(path)
        if not self._path.is_dir():
            what = "is a file" if self._path.exists() else "does not exist"
            raise UserError(f"{path}: {what}; give the folder into which scans are written")
        self.stop = threading.Event()
        self.skipped: list[SkippedScan] = []
        self.remarks: list[str] = []
        self._stamps = GrowingStamps(self._path)
        self._known = set[str]()  # names of files that were taken or skipped
        self._last: Path | None = None
        self._index = 0

    def __iter__(self) -> Iterator[Arrival]:
        """Yields the scans whose stamps increase; waits for the next one until `stop` is set.

        After a pause of more than ten seconds, a scan waits for the next one: if its stamp was wrong, only it is lost.
        """
        rule, turns, arrivals, ahead = StampRule(), TurnTimes(), self._arrivals(), deque[Arrival]()

        def known() -> list[int]:
            return [arrival.scan.stamp_ns for arrival in ahead]

        def awaited() -> list[int]:
            ahead.extend(islice(arrivals, 0 if ahead else 1))
            return known()

        while arrival := ahead.popleft() if ahead else next(arrivals, None):
            scan, is_first = arrival.scan, rule.last_ns is None
            if reason := rule.judge(scan.index, scan.stamp_ns, known if is_first else awaited):
                self._skip(scan.index, scan.path, reason)
            else:
                times = turns.in_seconds(scan.stamp_ns, scan.point_times, known)
                yield replace(arrival, scan=replace(scan, point_times=times))
        self.remarks.extend(remark for remark in (rule.remark(), turns.remark) if remark)

    def _arrivals(self) -> Iterator[Arrival]:
        while not self.stop.wait(_WAIT):
            new = set(os.listdir(self._path)) - self._known
            files = sorted(filter(is_scan, map(self._path.joinpath, new)), key=lambda file: natural_key(file.name))
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
        if last is not None and natural_key(file.name) < natural_key(last.name):
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

    def _skip(self, index: int, file: Path, reason: str) -> None:
        self.skipped.append(SkippedScan(index, file, reason, file.name))


def _is_complete(file: Path, is_left: bool) -> bool:
    try:
        about = file.stat()
    except FileNotFoundError:  # gone; reading it will say so
        return True
    return about.st_size > 0 and time.time() - about.st_mtime > (_LEFT if is_left else _SETTLED)


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
            self._times = times_of(self._folder)
            self._in_names = self._times is None and stamp_of(file) is not None
        if self._times is not None:
            if index >= len(self._stamps):
                self._read_on(self._times)
            return self._stamps[index] if index < len(self._stamps) else None
        stamp = stamp_of(file)
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
