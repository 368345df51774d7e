"""A scan, and the interface of all sources of scans."""

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from itertools import count, islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.common.errors import EndOfScansError, UnreadableScanError, UserError
from data.scans.point_times import LOOK_AHEAD, Stamped, StampRule, TurnTimes, seconds_after
from data.trajectory import Trajectory

WORST_SHARE_SKIPPED = 0.2

_FAR = 1e9  # m

_AHEAD = LOOK_AHEAD  # scans read ahead, so that a slow reader does not delay the run


@dataclass(frozen=True)
class Scan:
    """One scan: `points` (N, 3) float64, C-contiguous, metres, sensor frame, N >= 1, all finite.

    `index` counts the source's scans, skipped ones too; `dropped` is the number of NaN, infinite and zero returns that
    were removed, and of those without a time where most have one. `point_times` (N,) are seconds after the stamp, None
    if unknown. `T_odom_sensor` (4, 4) is the pose that the file gives, None if it gives none; `step_covariance` (6, 6)
    is that of the motion since the previous scan, rotation (rad) first, in the sensor's axes, None if unknown.
    """

    index: int
    stamp_ns: int
    points: NDArray[np.float64]
    dropped: int = 0
    path: Path = Path()
    point_times: NDArray[np.float64] | None = None
    T_odom_sensor: NDArray[np.float64] | None = None
    step_covariance: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class SkippedScan:
    """A scan that could not be used, and the reason."""

    index: int
    path: Path
    reason: str
    name: str


class ScanSource(ABC):
    """Scans in order; iterating reads them one by one, a few ahead.

    Attributes: `path`, `note` (one line for the user if something is a guess, otherwise None), `stamps_ns` ((N,) int64;
    None if they become known only while reading), `given` (all poses T_odom_sensor of another SLAM system, None if
    there are none), `stamped` (the instant of a scan that its stamp names), `is_dense` (whether the scans follow one
    another as a LiDAR takes them; false for keyframes and for pieces of a map), and, filled while iterating, `skipped`
    and `remarks` (one line for each thing that the user should know about the data).
    """

    path: Path
    note: str | None = None
    stamps_ns: NDArray[np.int64] | None = None
    given: Trajectory | None = None
    stamped: Stamped = "start"
    is_dense: bool = True

    def __init__(self) -> None:
        self.skipped: list[SkippedScan] = []
        self.remarks: list[str] = []

    @abstractmethod
    def __len__(self) -> int:
        """The number of scans, readable or not."""

    @abstractmethod
    def _read(self, index: int) -> Scan:
        """Reads a scan; called in order, by another thread. Raises UnreadableScanError on failure, EndOfScansError
        where there are fewer scans than it seemed."""

    def _name(self, index: int) -> tuple[Path, str]:
        """The file of a scan and its name."""
        return self.path, f"{self.path.name}, scan {index}"

    def __iter__(self) -> Iterator[Scan]:
        """Yields the usable scans; the others are listed in `skipped`.

        Scans with impossible stamps are skipped too: stamps that repeat, go back, or are far ahead of those that
        follow. Raises UserError as soon as more than a fifth has been skipped.
        """
        self.skipped, self.remarks, rule, turns = [], [], StampRule(), TurnTimes()
        with ThreadPoolExecutor(1) as reader:
            jobs = (partial(self._read, index) for index in range(len(self)))
            ahead: deque[Future[Scan]] = deque(reader.submit(job) for job in islice(jobs, _AHEAD))
            for index in count():
                if not ahead:
                    break
                current = ahead.popleft()
                ahead.extend(reader.submit(job) for job in islice(jobs, 1))
                try:
                    scan = current.result()
                except UnreadableScanError as error:
                    self._skip(index, str(error))
                    continue
                except EndOfScansError:
                    break
                if reason := rule.judge(index, scan.stamp_ns, lambda: self._stamps_of(ahead)):
                    self._skip(index, reason)
                else:
                    times = turns.in_seconds(scan.stamp_ns, scan.point_times, lambda: self._stamps_of(list(ahead)[:2]))
                    yield replace(scan, point_times=times)
        self.remarks.extend(remark for remark in (rule.remark(), turns.remark) if remark)

    @staticmethod
    def _stamps_of(ahead: Iterable["Future[Scan]"]) -> list[int]:
        return [future.result().stamp_ns for future in ahead if future.exception() is None]

    def _skip(self, index: int, reason: str) -> None:
        path, name = self._name(index)
        self.skipped.append(SkippedScan(index, path, reason, name))
        if len(self.skipped) > WORST_SHARE_SKIPPED * len(self):
            first = self.skipped[0]
            raise UserError(
                f"{self.path}: at least {len(self.skipped)} of {len(self)} scans cannot be read, more than a fifth; "
                f"the first is {first.name}: {first.reason}"
            )


def finished(
    index: int, stamp_ns: int, points: NDArray[Any], times: NDArray[Any] | None, path: Path,
    T_odom_sensor: NDArray[np.float64] | None = None, stamped: Stamped = "start",
) -> Scan:  # fmt: skip
    """Returns a scan of points (N, 3) and their times (N,) as stored (see `point_times`), without NaN, infinite and
    zero returns, and without those that have no time where most have one; its stamp is that of the instant `stamped`.

    Raises UnreadableScanError if nothing is left.
    """
    if not len(points):
        raise UnreadableScanError("it is empty")
    count_all, points = len(points), np.ascontiguousarray(points, dtype=np.float64)
    if not (points.all() and points.min() > -_FAR and points.max() < _FAR):  # most scans need no second look
        # squared ranges: NaN and infinity fail the comparison, and so does a return of all zeros
        with np.errstate(over="ignore", invalid="ignore"):
            squared = np.einsum("ij,ij->i", points, points)
            good = (squared > 0) & (squared < np.inf)
        if not good.any():
            raise UnreadableScanError("all of its returns are NaN, infinite or zero")
        points, times = points[good], None if times is None else times[good]
    if times is not None and times.dtype.kind == "f" and 0.5 < (known := np.isfinite(times)).mean() < 1:
        points, times = points[known], times[known]
    after = None if times is None else seconds_after(times, stamp_ns, stamped)
    return Scan(index, stamp_ns, points, count_all - len(points), path, after, T_odom_sensor)
