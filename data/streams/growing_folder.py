"""The scans of a folder that a recorder fills while we read it."""

import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from data.common.errors import UserError
from data.common.files import natural_key
from data.scans.formats import READERS, read_timed
from data.scans.reading_errors import UnreadableScanError
from data.scans.scan import finished
from data.streams.arrivals import Arrival, ScanStream
from data.streams.closed_files import ClosedFiles
from data.streams.growing_stamps import GrowingStamps
from data.trajectory.stamps import NOTE_INDICES, ns_to_seconds

_SETTLED = 1.0  # s after its last change from which a file is complete, even if its closing was not reported
_WAIT = 0.1  # s for the next file, and _BLOCKED for the end of one that is being written
_BLOCKED = 0.01
_LOOK = 1.0  # s without a word on any file after which the folder is listed again


class GrowingFolder(ScanStream):
    """Takes each scan file once it is complete: its writer has closed it or renamed it into the folder, or it has not
    changed for a second.

    Scans are taken in the natural order of their names; one that comes after a later one is skipped. Names that begin
    with a dot are left alone.
    """

    def __init__(self, path: Path | str) -> None:
        """Raises UserError if there is no such folder, or it cannot be watched."""
        super().__init__(Path(path))
        if not self.path.is_dir():
            what = "is a file" if self.path.exists() else "does not exist"
            raise UserError(f"{self.path}: {what}; give the folder into which scans are written")
        try:
            self._closed = ClosedFiles(self.path)
        except OSError as error:
            raise UserError(f"{self.path}: cannot be watched ({error.strerror}); give another folder") from None
        self._stamps = GrowingStamps(self.path)
        self._known = set[str]()  # names of files that were taken or skipped
        self._written = set[str]()  # of files that were closed and are not taken yet
        self._pending = self._listed()
        self._looked_s = time.monotonic()
        self._last: Path | None = None
        self._index = 0

    def _arrivals(self) -> Iterator[Arrival]:
        with closing(self._closed):
            yield from self._until_stopped()

    def _until_stopped(self) -> Iterator[Arrival]:
        while not self.stop.is_set():
            blocked = False
            for file in sorted((self.path / name for name in self._pending), key=_order):
                stamp_ns = self._stamps.stamp_ns(self._index, file) if self._is_complete(file) else None
                if stamp_ns is None:  # those after it wait for it
                    blocked = True
                    break
                yield from self._read(file, stamp_ns, time.perf_counter())
                if self.stop.is_set():
                    return
            self._look(_BLOCKED if blocked else _WAIT)

    def _look(self, seconds: float) -> None:
        """Waits for new files, for at most so long."""
        written = {name for name in self._closed.wait(seconds) if _is_scan(name)} - self._known
        self._written |= written
        self._pending |= written
        now_s = time.monotonic()
        if written:
            self._looked_s = now_s
        elif now_s - self._looked_s > _LOOK:
            self._looked_s = now_s
            self._pending |= self._listed()

    def _listed(self) -> set[str]:
        return {file.name for file in self.path.iterdir() if _is_scan(file.name)} - self._known

    def _is_complete(self, file: Path) -> bool:
        if file.name in self._written:
            return True
        try:
            about = file.stat()
        except FileNotFoundError:  # gone; reading it will say so
            return True
        return about.st_size > 0 and time.time() - about.st_mtime > _SETTLED

    def _read(self, file: Path, stamp_ns: int, came_s: float) -> Iterator[Arrival]:
        self._known.add(file.name)
        self._written.discard(file.name)
        self._pending.discard(file.name)
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


def _order(file: Path) -> tuple[tuple[int, int, str], ...]:
    return natural_key(file.name)
