"""The points of all scans that registration used, in a file: the second pass registers them again."""

import logging
import mmap
import os
import tempfile
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from sgslam.config import TrackingSettings
from sgslam.mapping import KeyframeClouds
from sgslam.registration.motion import thinned
from sgslam.registration.points import UNKNOWN
from sgslam.types import TimedPoints, TrackedScan

FILE = "scan_points.bin"  # in a run's folder, until it has finished
_log = logging.getLogger(__name__)


class ScanPoints:
    """The points of each scan of a map, in the order of the scans; places and normals in single precision.

    They are in the folder of the run's `clouds`, or in an unnamed file. What was written lately is in memory, as with
    any file. If the disk is full, the points are dropped and there will be no second pass.
    """

    def __init__(self, settings: TrackingSettings, clouds: KeyframeClouds) -> None:
        self._settings, self._clouds = settings, clouds
        self._file: BinaryIO | None = None
        self._counts: list[tuple[int, int]] = []  # of the points and the knots of each scan
        self._end, self._side = 0, 0.0
        self._is_lost = False

    def __len__(self) -> int:
        """The number of scans whose points can be read."""
        return 0 if self._is_lost else len(self._counts)

    @property
    def _path(self) -> Path | None:
        return None if self._clouds.path is None else self._clouds.path.parent / FILE

    def add(self, scan: TrackedScan) -> None:
        """Stores the points of the next scan."""
        used = scan.registration.used
        if used is None:  # an external odometry chose them
            times = scan.registration.point_times
            used, self._side = thinned(scan.raw.points, times, 0.0, self._side, self._settings)
        record = used.seconds.tobytes() + used.knot_seconds.tobytes() + used.points.astype(np.float32).tobytes()
        self._counts.append((len(used.seconds), len(used.knot_seconds)))
        self._write(record)

    def _write(self, record: bytes) -> None:
        if self._is_lost:
            return
        try:
            written = os.pwrite(self._opened().fileno(), record, self._end)
            if written < len(record):
                raise OSError("only a part could be written")
        except OSError as error:
            _log.warning("%s: no second pass: the scans' points cannot be stored (%s)", self._path or "disk", error)
            self.drop()
        self._end += len(record)

    def _opened(self) -> BinaryIO:
        if self._file is None:
            if (path := self._path) is not None:
                path.touch()
            opened = tempfile.TemporaryFile(buffering=0) if path is None else path.open("r+b", buffering=0)  # noqa: SIM115
            self._file = cast(BinaryIO, opened)
            os.ftruncate(self._file.fileno(), self._end)  # drops what an earlier run left beyond
        return self._file

    def read(self) -> list[TimedPoints]:
        """The points of all scans, by seconds after each scan's stamp. The system may page them out."""
        mapped = mmap.mmap(self._opened().fileno(), self._end, access=mmap.ACCESS_COPY)
        found, place = list[TimedPoints](), 0
        for points, knots in self._counts:
            times = np.frombuffer(mapped, np.float64, points + knots, place)
            place += times.nbytes
            own: NDArray[Any] = np.frombuffer(mapped, np.float32, 6 * points, place).reshape(points, 6)
            place += own.nbytes
            found.append(TimedPoints(own, times[:points], times[points:], np.full(points, UNKNOWN, np.int32)))
        return found

    def drop(self) -> None:
        """Deletes the points: no second pass follows."""
        self._is_lost = True
        if self._path is not None:
            self._path.unlink(missing_ok=True)

    def __getstate__(self) -> dict[str, Any]:
        """The attributes, without the points."""
        return {**vars(self), "_file": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """The points are lost where their file is."""
        vars(self).update(state)
        there = self._path is not None and self._path.is_file() and self._path.stat().st_size >= self._end
        self._is_lost |= not there
