"""Checks a scan before it is processed."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from data import UserError
from sgslam.geometry.frames import is_rigid
from sgslam.types import RawScan

Floats = NDArray[np.float64]
LONGEST_SCAN = 2.0  # s, of a scan; sensors in motion take 0.05 to 0.2


def checked_scan(
    stamp_ns: int, points: NDArray[np.floating[Any]], point_times: ArrayLike | None, T_odom_sensor: ArrayLike | None,
    step_covariance: ArrayLike | None, newest_ns: int | None,
) -> RawScan:  # fmt: skip
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
    if np.abs(seconds).max() > LONGEST_SCAN:
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
