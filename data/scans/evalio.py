"""Sequences of evalio's data sets as scans (github.com/contagon/evalio). Needs the extra `evalio`."""

import difflib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.common.errors import EndOfScansError, UnreadableScanError, UserError, refusing, required
from data.scans.scan import Scan, ScanSource

PREFIX = "evalio:"
Floats = NDArray[np.float64]


def is_evalio(path: Path | str) -> bool:
    """Whether this names a sequence, `evalio:DATASET/SEQUENCE`, and not a file or a folder."""
    return str(path).startswith(PREFIX)


class EvalioScans(ScanSource):
    """The scans of a sequence, streamed; stamps and poses are those of a scan's begin.

    The data lie where evalio looks for them (`EVALIO_DATA`); data sets of one's own are found as evalio finds them
    (`EVALIO_CUSTOM`).
    """

    def __init__(self, name: Path | str) -> None:
        """Opens `evalio:DATASET/SEQUENCE`. Raises UserError if evalio is missing, has no such sequence, or finds no
        data of it."""
        super().__init__()
        self._sequence = _found(str(name).removeprefix(PREFIX))
        self._limits = self._sequence.lidar_params()
        folder = Path(self._sequence.folder)  # the data may lie elsewhere
        self.path = folder if folder.exists() else next(map(Path, self._sequence.files()), folder)
        with refusing(f"{name}: its data in {self.path} cannot be read"):
            self._count = len(self._sequence.data_iter())

    def __len__(self) -> int:
        """The number of scans."""
        return self._count

    def __iter__(self) -> Iterator[Scan]:
        self._measurements = iter(self._sequence.lidar())
        return super().__iter__()

    def _read(self, index: int) -> Scan:
        with refusing("a broken scan", kind=UnreadableScanError):
            measurement = next(self._measurements, None)
        if measurement is None:
            raise EndOfScansError
        points, times = points_in_reach(measurement, self._limits)
        if not len(points):
            raise UnreadableScanError("no return lies within the sensor's reach")
        dropped = len(measurement.points) - len(points)
        return Scan(index, measurement.stamp.to_nsec(), points, dropped, self.path, times)


def points_in_reach(measurement: Any, limits: Any) -> tuple[Floats, Floats | None]:
    """The points (N, 3) of an evalio `LidarMeasurement`, metres, LiDAR frame, and their times (N,), seconds after its
    stamp; no times where all are equal: the data set does not know them.

    Returns that are not finite or not within the ranges of the `LidarParams` are left out: they show the carrier.
    """
    points = np.array(measurement.to_vec_positions()).reshape(-1, 3)
    times = np.array(measurement.to_vec_stamps())
    with np.errstate(invalid="ignore", over="ignore"):
        ranges = np.sqrt(np.einsum("ij,ij->i", points, points))
        good = (ranges > 0) & (ranges >= limits.min_range) & (ranges <= limits.max_range)
    points, times = np.ascontiguousarray(points[good]), times[good]
    return points, times if len(times) and np.ptp(times) > 0 else None


def _found(name: str) -> Any:
    required("evalio", f"{PREFIX}{name}", "evalio")
    from evalio import datasets

    known = datasets.all_sequences()
    if name not in known:
        near = difflib.get_close_matches(name, known, 1, 0.0)[0]
        raise UserError(f"{PREFIX}{name}: no such sequence; did you mean '{near}'? 'evalio ls datasets' lists all")
    sequence = known[name]
    if not sequence.is_downloaded():
        folder = datasets.get_data_dir()
        raise UserError(f"{PREFIX}{name}: no data in {folder}; 'evalio dl {name}', or set EVALIO_DATA to their folder")
    return sequence
