"""Whether a scan can have been taken near the one before it, or the sensor was carried elsewhere in between."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from sgslam.geometry.frames import se2_to_se3, transform_points
from sgslam.perception.column_scan import ColumnScan
from sgslam.serialization.state_tree import Stateful
from sgslam.tracking.alignment import chosen

Floats = NDArray[np.float64]
_SECTORS = 180  # directions; as wide as the columns that are kept of a scan, or wider
_NEAR = 0.4  # m by which the distance in one direction may change from one scan to the next
_MIN_SIMILARITY = 0.6  # of the directions; from scan to scan of a drive it is 0.8 and more
_TURNS, _WITHIN = 12, 0.15  # of the search; m from what was seen before
_MIN_EXPLAINED = 0.55  # of a scan that what was seen before must explain, whichever way it is turned
_POINTS, _REACH = 700, 1.5  # of a scan that are registered; m


@dataclass(frozen=True, eq=False)
class _Signature:
    """Of a scan: (N, 3) points on upright surfaces, sensor frame, and their mean distance in each direction, NaN where
    there are none."""

    points: Floats
    distances: Floats

    @staticmethod
    def of(scan: ColumnScan) -> "_Signature":
        upright = chosen(scan.upright, _POINTS)
        points, sector = scan.points.take(upright, axis=0), scan.column.take(upright) * _SECTORS // scan.columns
        return _Signature(points, _distances(points, sector))


@compiled
def _distances(points: Floats, sector: NDArray[np.int64]) -> Floats:
    total, count = np.zeros(_SECTORS), np.zeros(_SECTORS)
    for i in range(len(points)):
        total[sector[i]] += math.hypot(points[i, 0], points[i, 1])
        count[sector[i]] += 1
    return total / count  # NaN where there are none


class KidnapDetector(Stateful):
    """Remembers the newest scan that fitted."""

    _STATE = ("_points", "_distances")

    def __init__(self) -> None:
        self._points: Floats | None = None  # (N, 3) on upright surfaces, sensor frame
        self._distances: Floats = np.empty(0)  # in each direction
        self._looked: tuple[ColumnScan, _Signature] | None = None

    def keep(self, scan: ColumnScan) -> None:
        """Takes a scan for the newest that fits."""
        signature = self._signature(scan)
        self._points, self._distances = signature.points, signature.distances

    def fits(self, scan: ColumnScan) -> bool:
        """Whether a scan may have been taken where the newest one was, or some steps away.

        First by the distances in all directions, turned a little; where these differ, by registration from all sides.
        """
        signature = self._signature(scan)
        if self._points is None or _similarity(self._distances, signature.distances) >= _MIN_SIMILARITY:
            return True
        if min(len(signature.points), len(self._points)) < 50:
            return True  # too little to say that it was not
        return _explained(self._points, signature.points) >= _MIN_EXPLAINED

    def _signature(self, scan: ColumnScan) -> _Signature:
        if self._looked is None or self._looked[0] is not scan:
            self._looked = scan, _Signature.of(scan)
        return self._looked[1]


def all_fit(scans: list[ColumnScan]) -> bool:
    """Whether each may have been taken near the one before it: a sensor that was carried elsewhere is somewhere then;
    where none fits to another, the scans are only far apart."""
    watch = KidnapDetector()
    for scan in scans:
        if not watch.fits(scan):
            return False
        watch.keep(scan)
    return True


def _similarity(before: Floats, now: Floats) -> float:
    """The share of directions with the same distance, at the best of some turns by up to 15 degrees."""
    least = _SECTORS // 6
    off = np.abs(before - now)
    known = int(np.count_nonzero(off == off))  # NaN is not
    straight = int(np.count_nonzero(off < _NEAR)) / max(known, least)
    if straight >= _MIN_SIMILARITY:
        return straight  # as nearly always
    turns = np.arange(-_SECTORS // 24, _SECTORS // 24 + 1)
    off = np.abs(before[(np.arange(_SECTORS) - turns[:, None]) % _SECTORS] - now)
    present = np.isfinite(off)
    return float(np.max(((off < _NEAR) & present).sum(axis=1) / np.maximum(present.sum(axis=1), least)))


def _explained(before: Floats, now: Floats) -> float:
    """The largest share of points (N, 3) that lie on those of before (M, 3), over registrations from all sides."""
    import small_gicp

    target, source = small_gicp.PointCloud(before), small_gicp.PointCloud(now)
    tree, best = small_gicp.KdTree(target, num_threads=1), 0.0
    for turn in range(_TURNS):
        found = small_gicp.align(
            target, source, tree, init_T_target_source=se2_to_se3(2 * np.pi * turn / _TURNS, 0.0, 0.0),
            registration_type="ICP", max_correspondence_distance=_REACH, max_iterations=20, num_threads=1,
        )  # fmt: skip
        moved = transform_points(found.T_target_source, now)
        _, squared = tree.batch_nearest_neighbor_search(moved, num_threads=1)
        best = max(best, float(np.mean(np.asarray(squared) < _WITHIN**2)))
    return best
