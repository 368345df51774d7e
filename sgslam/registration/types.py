"""What a registration returns."""

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sgslam.config import TrackingSettings
from sgslam.inertial import UnsteadyTurn
from sgslam.registration.motion_prior import moved_on, velocity_between
from sgslam.registration.points import placed, undistorted
from sgslam.registration.sampling import TimedPoints, one_a_cell

Floats = NDArray[np.float64]
Health = Literal["good", "degraded", "lost"]
_SIDE = 0.1  # m between the points that are used of a scan that an external odometry registered


@dataclass(frozen=True, eq=False)
class Motion:
    """Poses of the sensor in `odom`: `knots` (K, 4, 4) at `seconds` (K,), ascending; steady motion between them."""

    seconds: Floats
    knots: Floats

    def at(self, second: float) -> Floats:
        """(4, 4) the pose at any time, beyond both ends by the motion there."""
        if len(self.knots) == 1:
            return self.knots[0].copy()
        k = int(np.clip(np.searchsorted(self.seconds, second, side="right") - 1, 0, len(self.knots) - 2))
        return np.asarray(moved_on(self.knots[k], self.velocity(k), second - self.seconds[k]))

    def velocity(self, knot: int) -> Floats:
        """(6,) the velocity from a knot to the next one: rotation vector and translation, axes of `odom`, a second."""
        seconds = self.seconds[knot + 1] - self.seconds[knot]
        return np.asarray(velocity_between(self.knots[knot], self.knots[knot + 1], seconds))

    def placed(self, points: Floats, seconds: Floats) -> Floats:
        """Points (N, 3), measured at `seconds` (N,), in `odom`."""
        return self.seen(points, seconds)[0]

    def seen(self, points: Floats, seconds: Floats) -> tuple[Floats, Floats]:
        """Points (N, 3), measured at `seconds` (N,), and the unit rays (N, 3) to them, in `odom`."""
        return placed(points, seconds, self.seconds, self.knots)


@dataclass(frozen=True, eq=False)
class Registration:
    """The result of registering a scan: `T_odom_sensor` (4, 4) at its stamp, and how good it is.

    `covariance` (6, 6) is that of the pose relative to the local map, rotation (rad) first, then translation (m), in
    the sensor's axes. `health` is "degraded" if only the motion prior constrains some directions, which are the unit
    twists `unconstrained` (M, 6), rotation first, in the sensor's axes; it is "lost" if the scan does not fit the map,
    and the pose is then a prediction. `share` is the share of the scan's points that are on known surfaces. `motion` is
    the motion during the scan, by seconds after its stamp; `point_times` (N,) are the times that were used, None for a
    snapshot. With an IMU, `unsteady` is what it measures of the turns within the scan, by the same seconds. A scan
    `is_after_pause` if none came for long before it, and nothing else measured how the sensor moved. `used` are the
    points that were registered, by the same seconds; None where an external odometry chose them.
    """

    T_odom_sensor: Floats
    covariance: Floats
    health: Health
    share: float
    motion: Motion
    point_times: Floats | None = None
    unconstrained: Floats = field(default_factory=lambda: np.empty((0, 6)))
    unsteady: UnsteadyTurn | None = None
    is_after_pause: bool = False
    used: TimedPoints | None = None

    def undistorted(self, points: Floats) -> Floats:
        """Returns the points (N, 3) of the scan as the sensor would have measured them at its stamp."""
        if self.point_times is None:
            return points
        steady = points if self.unsteady is None else self.unsteady.steadied(points, self.point_times)
        return self._at_stamp(steady, self.point_times)

    def thinned(self, points: Floats, settings: TrackingSettings) -> Floats:
        """Returns a few of the points (N, 3) of the scan, spread evenly in space, as `undistorted` does."""
        if self.used is not None:
            return self._at_stamp(self.used.points, self.used.seconds)
        own = one_a_cell(points, _SIDE, settings.min_range, settings.max_range)
        times = None if self.point_times is None else self.point_times[own]
        return replace(self, point_times=times).undistorted(points[own])

    def _at_stamp(self, steady: Floats, seconds: Floats) -> Floats:
        return undistorted(steady, seconds, self.motion.seconds, self.motion.knots, self.T_odom_sensor)
