"""Kidnap detection: whether a scan was taken near the one before it, or the sensor was carried elsewhere in between."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from sgslam.geometry.frames import se2_to_se3, transform_points
from sgslam.perception import ColumnScan
from sgslam.serialization import Stateful
from sgslam.tracking.alignment import chosen

Floats = NDArray[np.float64]
_SECTORS = 180  # directions, at least as wide as the columns that are used of a scan
_NEAR = 0.4  # m by which the distance in one direction may change from one scan to the next
_MIN_SIMILARITY = 0.6  # share of the directions; in a continuous drive it is 0.8 or more
_TURNS, _WITHIN = 12, 0.15  # start headings of the search; m from a point of the scan before
_MIN_EXPLAINED = 0.55  # share of a scan that the scan before must explain at the best heading
_POINTS, _REACH = 700, 1.5  # points of a scan that are registered; m between corresponding ones


@dataclass(frozen=True, eq=False)
class _Signature:
    """Points (N, 3) of a scan on upright surfaces, sensor frame, and their mean `distances` (180,) by direction.

    Distances are NaN in directions without points.
    """

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
    """Compares each scan with the newest one that fitted."""

    _STATE = ("_points", "_distances")

    def __init__(self) -> None:
        self._points: Floats | None = None  # (N, 3) on upright surfaces, sensor frame
        self._distances: Floats = np.empty(0)  # in each direction
        self._looked: tuple[ColumnScan, _Signature] | None = None

    def keep(self, scan: ColumnScan) -> None:
        """Makes a scan the newest that fits."""
        signature = self._signature(scan)
        self._points, self._distances = signature.points, signature.distances

    def fits(self, scan: ColumnScan) -> bool:
        """Whether a scan may have been taken near the newest one.

        Compares the distances in all directions at small turns first; where these differ, registers the scan from all
        headings.
        """
        signature = self._signature(scan)
        if self._points is None or _similarity(self._distances, signature.distances) >= _MIN_SIMILARITY:
            return True
        if min(len(signature.points), len(self._points)) < 50:
            return True  # too few points to decide
        return _explained(self._points, signature.points) >= _MIN_EXPLAINED

    def _signature(self, scan: ColumnScan) -> _Signature:
        if self._looked is None or self._looked[0] is not scan:
            self._looked = scan, _Signature.of(scan)
        return self._looked[1]


def all_fit(scans: list[ColumnScan]) -> bool:
    """Whether each scan may have been taken near the one before it.

    After a kidnap the new scans fit one another. Where none fits the next, the scans are merely far apart.
    """
    watch = KidnapDetector()
    for scan in scans:
        if not watch.fits(scan):
            return False
        watch.keep(scan)
    return True


def _similarity(before: Floats, now: Floats) -> float:
    """The share of directions with the same distance, at the best of turns by up to 15 degrees."""
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
