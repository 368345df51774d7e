"""The protocol of an odometry of others, which gives a pose for each scan, and what the adapters of them share."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from data.trajectory.stamps import NS
from sgslam.registration.motion import SHORTEST
from sgslam.registration.motion_prior import moved_on, velocity_between
from sgslam.types import Motion

Floats = NDArray[np.float64]
ROUNDS = 3  # of undistorting a scan by the motion that it shows: by the step before it, and only once, it may diverge
LEAST = 20  # points that a registration by others needs
GAP_NS = NS  # a longer step between two poses does not tell how the sensor moved within it


class Odometry(Protocol):
    """Anything that locates the sensor scan by scan, in one frame. The stamps increase, and no scan comes twice.

    A run takes its poses as it takes those of a file: see `GivenMotion`. The state of a run holds one that pickles.
    """

    def locate(self, stamp_ns: int, points: Floats, point_times: Floats | None = None) -> Floats:
        """T_odom_sensor (4, 4) at the stamp of a scan, of its points (N, 3), N >= 1, in the sensor frame, measured
        `point_times` (N,) seconds after the stamp (None if unknown)."""
        ...


def steady_motion(T_odom_sensor: Floats, velocity: Floats, at: float, point_times: Floats | None) -> Motion:
    """The motion during a scan with a steady velocity (6,), and the pose (4, 4) `at` seconds after its stamp."""
    if is_snapshot(point_times):
        return Motion(np.zeros(1), np.asarray(moved_on(T_odom_sensor, velocity, -at))[None])
    assert point_times is not None
    seconds = np.array([point_times.min(), point_times.max()])
    return Motion(seconds, np.stack([moved_on(T_odom_sensor, velocity, s - at) for s in seconds]))


def is_snapshot(point_times: Floats | None) -> bool:
    """Whether all points of a scan are of one instant, or their times (N,) are unknown."""
    return point_times is None or len(point_times) < 2 or bool(np.ptp(point_times) < SHORTEST)


def end_of(point_times: Floats | None) -> float:
    """Seconds from a scan's stamp to its last point; 0 where the points have no times."""
    return 0.0 if point_times is None or not len(point_times) else float(point_times.max())


def seconds_since(before_ns: int | None, ended_ns: int) -> float:
    """From the end of the scan before to that of a scan; 0 for the first one, at least a millisecond for any other."""
    return 0.0 if before_ns is None else max((ended_ns - before_ns) / 1e9, SHORTEST)


def at_stamp(T_before: Floats, T_end: Floats, seconds: float, end: float) -> Floats:
    """(4, 4) the pose at a scan's stamp, `end` seconds before its end at `T_end`, of a sensor that moved there steadily
    from `T_before` in so many seconds; of the first scan that at its end."""
    velocity = velocity_between(T_before, T_end, seconds) if seconds else np.zeros(6)
    return np.asarray(moved_on(T_end, velocity, -end))
