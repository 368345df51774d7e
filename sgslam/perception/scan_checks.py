"""Refuses what is not a scan, before it is tracked; and by the first few, scans in another unit or frame."""

from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data import UserError
from data.scans import Scan
from sgslam.config.sensor import SENSOR
from sgslam.geometry.frames import is_rigid
from sgslam.types import RawScan

Floats = NDArray[np.float64]
_FEW = 3  # scans: a single odd one proves nothing
_FARTHEST = 100.0  # m, median range indoors and out of doors; in millimetres the sensor would touch all that it sees
_OUTSIDE = 10.0  # times the extent of a scan: a sensor so far from all that it sees is not at the origin


def checked_scan(
    stamp_ns: int,
    points: NDArray[np.floating[Any]],
    point_times: ArrayLike | None,
    T_odom_sensor: ArrayLike | None,
    step_covariance: ArrayLike | None,
    newest_ns: int | None,
) -> RawScan:
    """A scan as float64.

    Raises UserError for a stamp that is not an integer or not later than `newest_ns`, for no or non-finite points, for
    invalid times, for a `T_odom_sensor` that is not a rigid motion, and for a `step_covariance` that is none.
    """
    where = f"scan at {stamp_ns} ns"
    try:
        checked: Floats = np.ascontiguousarray(_array_of(points), dtype=np.float64)
    except (TypeError, ValueError):
        raise UserError(f"{where}: points must be an array (N, 3) of numbers") from None
    if checked.ndim != 2 or checked.shape[1] != 3 or not len(checked):
        raise UserError(f"{where}: points must be (N, 3), at least one, and finite; they are {checked.shape}")
    if not np.isfinite(checked.sum()):  # finite only if all numbers are
        raise UserError(f"{where}: points must be finite; drop the others: points[np.isfinite(points).all(axis=1)]")
    if not isinstance(stamp_ns, (int, np.integer)):
        raise UserError(f"{where}: the stamp must be a whole number of nanoseconds, not {type(stamp_ns).__name__}")
    if newest_ns is not None and stamp_ns <= newest_ns:
        raise UserError(f"{where}: stamps must increase; the last was {newest_ns} ns")
    pose = None if T_odom_sensor is None else _numbers(T_odom_sensor)
    if pose is not None and not is_rigid(pose):
        raise UserError(f"{where}: T_odom_sensor must be a finite rigid motion (4, 4)")
    times = None if point_times is None else _checked_times(point_times, len(checked), stamp_ns)
    step = None if step_covariance is None else checked_covariance(step_covariance, int(stamp_ns))
    return RawScan(int(stamp_ns), checked, times, pose, step)


def _numbers(values: ArrayLike) -> Floats:
    """The values as an array of a caller's numbers; empty where they are none."""
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError):
        return np.empty(0)


def _array_of(points: Any) -> Any:
    """The points of an Open3D cloud, legacy or tensor; anything else as it is."""
    if hasattr(points, "point"):
        return points.point.positions.cpu().numpy()
    return getattr(points, "points", points)


def _checked_times(point_times: ArrayLike, count: int, stamp_ns: int) -> Floats:
    """(N,) seconds after the stamp for each of `count` points; raises UserError for invalid times."""
    seconds = _numbers(point_times)
    if seconds.shape != (count,) or not np.isfinite(seconds.sum()):
        raise UserError(f"scan at {stamp_ns} ns: point_times must be ({count},) finite seconds after the stamp")
    if np.abs(seconds).max() > SENSOR.longest_scan:
        raise UserError(
            f"scan at {stamp_ns} ns: point_times are seconds after the stamp, not {seconds.min():g} to "
            f"{seconds.max():g}: are they milliseconds, nanoseconds, or a time of day?"
        )
    return seconds


def checked_covariance(covariance: ArrayLike, stamp_ns: int) -> Floats:
    """(6, 6) the covariance of a step; raises UserError where it is not symmetric or has a negative variance."""
    found = _numbers(covariance)
    is_one = found.shape == (6, 6) and np.isfinite(found.sum()) and np.allclose(found, found.T, rtol=1e-6)
    if not is_one or np.linalg.eigvalsh(found)[0] < -1e-9 * np.abs(found).max():
        raise UserError(f"scan at {stamp_ns} ns: step_covariance must be a covariance (6, 6), rotation first")
    return found


def in_metres_and_sensor_frame(scans: Iterable[Scan]) -> Iterator[Scan]:
    """Yields the scans. Raises UserError if each of the first few is in another unit or frame."""
    rest, first, fault = iter(scans), list[Scan](), None
    for scan in islice(rest, _FEW):
        first.append(scan)
        fault = _fault(scan.points)
        if fault is None:
            break
    if fault is not None:
        raise UserError(f"{first[-1].path}: {fault}")
    yield from first
    yield from rest


def _fault(points: NDArray[np.float64]) -> str | None:
    """What is wrong with the frame or the unit of a scan (N, 3), None where nothing is."""
    middle = np.median(points, axis=0)
    distance = float(np.linalg.norm(middle))
    extent = float(np.median(np.linalg.norm(points - middle, axis=1)))
    if distance > _OUTSIDE * extent:
        return (
            f"the scan lies {distance:.0f} m from the origin and is {2 * extent:.0f} m wide: the scans seem to be in "
            "one world frame; give each in its own sensor frame"
        )
    far = float(np.median(np.linalg.norm(points, axis=1)))
    if far > _FARTHEST:
        return (
            f"the median range is {far:.0f} m: the scans are not in metres; divide millimetres by 1000, centimetres "
            "by 100"
        )
    return None
