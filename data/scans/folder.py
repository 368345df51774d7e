"""Scans in order as `Scan`s, and a folder of them, everything that is cheap to check checked before one is read."""

import re
from abc import ABC, abstractmethod
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import count, islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.scans.formats import READERS, EndOfScansError, UnreadableScanError, read_timed
from data.scans.point_times import seconds_after
from data.scans.stamp_rule import LOOK_AHEAD, StampRule, unusable
from data.trajectory.stamps import NOTE_INDICES, SCAN_PERIOD_NS, check_increasing, read_times, stamps_from_names

WORST_SHARE_SKIPPED = 0.2
_FAR = 1e9  # m
_AHEAD = LOOK_AHEAD  # scans read before they are asked for, so that a reader that is held up holds up nobody


@dataclass(frozen=True)
class Scan:
    """One scan: `points` (N, 3) float64, C-contiguous, metres, sensor frame, N >= 1, all finite.

    `index` counts the source's scans, skipped ones too; `dropped` is how many NaN, infinite and zero returns
    were taken out. `point_times` (N,) are seconds after the stamp, None where they are not known. `T_odom_sensor`
    (4, 4) is the pose that the file gives, None where it gives none.
    """

    index: int
    stamp_ns: int
    points: NDArray[np.float64]
    dropped: int
    path: Path
    point_times: NDArray[np.float64] | None = None
    T_odom_sensor: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class SkippedScan:
    """A scan that could not be used, and why."""

    index: int
    path: Path
    reason: str
    name: str


class ScanSource(ABC):
    """Scans in order; iterating reads them one by one, a few ahead.

    Attributes: `path`, `note` (one line for the user where something is a guess, else None), `stamps_ns` ((N,) int64;
    None where they are known only while reading), and, filled while iterating, `skipped` and `remarks` (one line each
    on what the user should know of the data).
    """

    path: Path
    note: str | None = None
    stamps_ns: NDArray[np.int64] | None = None

    def __init__(self) -> None:
        self.skipped: list[SkippedScan] = []
        self.remarks: list[str] = []

    @abstractmethod
    def __len__(self) -> int:
        """How many scans there are, readable or not."""

    @abstractmethod
    def _jobs(self) -> Iterator[Callable[[], Scan]]:
        """What reads each scan, in order; it raises UnreadableScanError where it cannot, EndOfScansError at the end."""

    def _name(self, index: int) -> tuple[Path, str]:
        """The file of a scan and what to call it."""
        return self.path, f"{self.path.name}, scan {index}"

    def __iter__(self) -> Iterator[Scan]:
        """Yields the usable scans; those skipped are listed in `skipped`.

        Left out is also what cannot be in time: stamps that repeat, go back, or are far ahead of those that follow.
        Raises UserError as soon as more than a fifth has been skipped.
        """
        self.skipped, self.remarks, rule = [], [], StampRule()
        with ThreadPoolExecutor(1) as reader:
            jobs = self._jobs()
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
                    yield scan
        if remark := rule.remark():
            self.remarks.append(remark)

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


class ScanFolder(ScanSource):
    """The scans of a folder in natural order of their names. Also `files`; `stamps_ns` is always there."""

    stamps_ns: NDArray[np.int64]

    def __init__(self, path: Path | str) -> None:
        """Lists the files and settles their stamps; reads no scan.

        Raises UserError for a folder that is missing, empty or of mixed formats, and for stamps that are too
        many or too few, or of which more than a fifth repeat or go backwards.
        """
        super().__init__()
        self.path = Path(path)
        files = _list_scans(self.path)
        self.files, stamps, self.note = _order_and_stamps(self.path, files)
        self.stamps_ns = np.array(stamps, dtype=np.int64)
        if unusable(stamps) > WORST_SHARE_SKIPPED * len(stamps):
            check_increasing(self.stamps_ns, str(self.path), [f"'{f.name}'" for f in self.files])

    def __len__(self) -> int:
        """How many scans the folder holds, readable or not."""
        return len(self.files)

    def _jobs(self) -> Iterator[Callable[[], Scan]]:
        return (partial(self._read, index) for index in range(len(self)))

    def _name(self, index: int) -> tuple[Path, str]:
        return self.files[index], self.files[index].name

    def _read(self, index: int) -> Scan:
        stamp_ns = int(self.stamps_ns[index])
        points, times = read_timed(self.files[index])
        return finished(index, stamp_ns, points, times, self.files[index])


def finished(
    index: int, stamp_ns: int, points: NDArray[Any], times: NDArray[Any] | None, path: Path,
    T_odom_sensor: NDArray[np.float64] | None = None,
) -> Scan:  # fmt: skip
    """A scan of points (N, 3) and their times (N,) as stored (see `point_times`), without NaN, infinite and zero
    returns. Raises UnreadableScanError where nothing is left.
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
    after = None if times is None else seconds_after(times, stamp_ns)
    return Scan(index, stamp_ns, points, count_all - len(points), path, after, T_odom_sensor)


def natural_key(name: str) -> tuple[tuple[int, int, str], ...]:
    """Sorts `2.pcd` before `10.pcd`: runs of digits compare as numbers, and the rest as text."""
    parts = re.findall(r"\d+|\D+", name)
    return tuple((0, int(p), p) if p[0] in "0123456789" else (1, 0, p) for p in parts)


def _list_scans(path: Path) -> list[Path]:
    if not path.is_dir():
        what = "is a file" if path.exists() else "does not exist"
        raise UserError(f"{path}: {what}; give a folder of scans ({', '.join(READERS)})")
    shown = [f for f in path.iterdir() if not f.name.startswith(".")]
    files = [f for f in shown if f.suffix.lower() in READERS and f.is_file()]
    if not files:
        raise UserError(f"{path}: no scans in it; give a folder of {', '.join(READERS)} files")
    formats = Counter(f.suffix.lower() for f in files)
    if len(formats) > 1:
        found = ", ".join(f"{count} {suffix}" for suffix, count in sorted(formats.items()))
        raise UserError(f"{path}: scans of mixed formats ({found}); leave one format in the folder")
    return sorted(files, key=lambda f: natural_key(f.name))


def _order_and_stamps(path: Path, files: list[Path]) -> tuple[list[Path], list[int], str | None]:
    """The files in order, their stamps (ns), and what to tell the user of the stamps."""
    for times in (path / "times.txt", path.resolve().parent / "times.txt"):
        if times.is_file():
            stamps = read_times(times)
            if len(stamps) != len(files):
                raise UserError(
                    f"{times}: {len(stamps)} stamps for the {len(files)} scans in {path}; "
                    "give one line for each scan"
                )
            return files, stamps, None
    named = stamps_from_names(files)
    if named is None:
        return files, [i * SCAN_PERIOD_NS for i in range(len(files))], NOTE_INDICES
    # seconds may have been printed with any number of places, and then 1.25 comes before 1.5, not after
    order = sorted(range(len(files)), key=named.__getitem__)
    return [files[i] for i in order], [named[i] for i in order], None
