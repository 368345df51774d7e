"""Where a moving sensor was at any time of a scan, and its points as seen from one instant."""

import numpy as np
from numpy.typing import NDArray

from sgslam.config import TrackingSettings
from sgslam.geometry.frames import inverse, transform_points
from sgslam.inertial import steadied
from sgslam.registration.motion_prior import moved_on, velocity_between
from sgslam.registration.points import placed
from sgslam.registration.sampling import thinned
from sgslam.types import Motion, Registration, TrackedScan

Floats = NDArray[np.float64]
_SIDE = 0.1  # m between the points that are used of a scan that an external odometry registered


def pose_at(motion: Motion, second: float) -> Floats:
    """(4, 4) the pose at any time, beyond both ends by the motion there."""
    if len(motion.knots) == 1:
        return motion.knots[0].copy()
    k = int(np.clip(np.searchsorted(motion.seconds, second, side="right") - 1, 0, len(motion.knots) - 2))
    return np.asarray(moved_on(motion.knots[k], velocity_after(motion, k), second - motion.seconds[k]))


def velocity_after(motion: Motion, knot: int) -> Floats:
    """(6,) the velocity from a knot to the next one: rotation vector and translation, axes of `odom`, a second."""
    seconds = motion.seconds[knot + 1] - motion.seconds[knot]
    return np.asarray(velocity_between(motion.knots[knot], motion.knots[knot + 1], seconds))


def deskewed(found: Registration, points: Floats) -> Floats:
    """The points (N, 3) of a scan as the sensor would have measured them at its stamp."""
    if found.point_times is None:
        return points
    steady = points if found.unsteady is None else steadied(found.unsteady, points, found.point_times)
    return _at_stamp(found, steady, found.point_times)


def few_points(found: Registration, points: Floats, settings: TrackingSettings) -> Floats:
    """A few of the points (N, 3) of a scan, spread evenly in space, as `deskewed` does: those that were registered."""
    few = found.used or thinned(points, found.point_times, 0.0, _SIDE, settings)[0]
    return _at_stamp(found, few.points, few.seconds)


def _at_stamp(found: Registration, steady: Floats, seconds: Floats) -> Floats:
    in_odom = placed(steady, seconds, found.motion.seconds, found.motion.knots)[0]
    return transform_points(inverse(found.T_odom_sensor), in_odom)


def motion_since_begin(scan: TrackedScan) -> Floats | None:
    """(4, 4) T_begin_sensor, the motion since a scan's first point, where that is before the stamp."""
    motion = scan.registration.motion
    if motion.seconds[0] >= 0:
        return None
    return inverse(pose_at(motion, float(motion.seconds[0]))) @ scan.registration.T_odom_sensor
