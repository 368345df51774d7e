"""A folder of scans as a sequence of `Scan`, everything that is cheap to check checked before one is read."""

import re
from collections import Counter, deque
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data.errors import UserError
from data.scan_formats import READERS, UnreadableScanError, read_points
from data.stamps import NOTE_INDICES, SCAN_PERIOD_NS, check_increasing, read_times, stamps_from_names

WORST_SHARE_SKIPPED = 0.2
_FAR = 1e9  # m
_AHEAD = 8  # scans read before they are asked for, so that a reader that is held up holds up nobody


@dataclass(frozen=True)
class Scan:
    """One scan: `points` (N, 3) float64, C-contiguous, metres, sensor frame, N >= 1, all finite.

    `index` counts the folder's scans, skipped ones too; `dropped` is how many NaN, infinite and zero returns
    were taken out.
    """

    index: int
    stamp_ns: int
    points: NDArray[np.float64]
    dropped: int
    path: Path


@dataclass(frozen=True)
class SkippedScan:
    """A scan that could not be used, and why."""

    index: int
    path: Path
    reason: str


class ScanFolder:
    """The scans of a folder in order; iterating reads them one by one, a few ahead.

    Attributes: `files`, `stamps_ns` ((N,) int64, strictly increasing), `note` (one line for the user where
    the stamps are a guess, else None), and `skipped`, filled while iterating.
    """

    def __init__(self, path: Path | str) -> None:
        """Lists the files and settles their stamps; reads no scan.

        Raises UserError for a folder that is missing, empty or of mixed formats, and for stamps that are too
        many or too few, repeat, or go backwards.
        """
        self.path = Path(path)
        files = _list_scans(self.path)
        self.files, stamps, self.note = _order_and_stamps(self.path, files)
        self.stamps_ns = np.array(stamps, dtype=np.int64)
        check_increasing(self.stamps_ns, str(self.path), [f"'{f.name}'" for f in self.files])
        self.skipped: list[SkippedScan] = []

    def __len__(self) -> int:
        """How many scans the folder holds, readable or not."""
        return len(self.files)

    def __iter__(self) -> Iterator[Scan]:
        """Yields the readable scans; those skipped are listed in `skipped`.

        Raises UserError as soon as more than a fifth of the folder has been skipped.
        """
        self.skipped = []
        with ThreadPoolExecutor(1) as reader:
            ahead: deque[Future[Scan]] = deque(reader.submit(self._read, i) for i in range(min(_AHEAD, len(self))))
            for index in range(len(self)):
                current = ahead.popleft()
                if index + _AHEAD < len(self):
                    ahead.append(reader.submit(self._read, index + _AHEAD))
                try:
                    scan = current.result()
                except UnreadableScanError as error:
                    self._skip(index, str(error))
                else:
                    yield scan

    def _read(self, index: int) -> Scan:
        raw = read_points(self.files[index])
        if not len(raw):
            raise UnreadableScanError("it is empty")
        points = np.ascontiguousarray(raw, dtype=np.float64)
        kept = len(points)
        if not (points.all() and points.min() > -_FAR and points.max() < _FAR):  # most scans need no second look
            # squared ranges: NaN and infinity fail the comparison, and so does a return of all zeros
            with np.errstate(over="ignore", invalid="ignore"):
                squared = np.einsum("ij,ij->i", points, points)
                good = (squared > 0) & (squared < np.inf)
            kept = int(np.count_nonzero(good))
        if not kept:
            raise UnreadableScanError("all of its returns are NaN, infinite or zero")
        dropped = len(points) - kept
        points = points[good] if dropped else points
        return Scan(index, int(self.stamps_ns[index]), points, dropped, self.files[index])

    def _skip(self, index: int, reason: str) -> None:
        self.skipped.append(SkippedScan(index, self.files[index], reason))
        if len(self.skipped) > WORST_SHARE_SKIPPED * len(self):
            first = self.skipped[0]
            raise UserError(
                f"{self.path}: at least {len(self.skipped)} of {len(self)} scans cannot be read, more than a fifth; "
                f"the first is {first.path.name}: {first.reason}"
            )


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
