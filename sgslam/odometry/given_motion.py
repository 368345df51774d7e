"""Poses that another system gives: taken as they are, or as measurements of the motion from scan to scan."""

import logging
from bisect import bisect_left, bisect_right

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from data.trajectory.stamps import NS
from sgslam.config import OdometrySettings
from sgslam.config.sensor import SENSOR
from sgslam.geometry.frames import inverse, squared_up
from sgslam.inertial import Steps
from sgslam.odometry.base import GAP_NS, steady_motion
from sgslam.registration.motion_prior import moved_on, velocity_between
from sgslam.types import Registration

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
_BEYOND = 0.1  # of a step: so far before the first pose and after the last, the motion still counts as measured
_KEPT_NS = 300 * NS  # longer than one waits for a lost sensor
_LEAST = 1e-6  # of the usual variance, the least that is believed
_EXACT = 1e-8  # rad2 and m2, of a pose that is taken as it is; what its steps err is for the map to say


class GivenMotion:
    """The newest given poses; between two of them the motion is taken as steady.

    Only the motion counts, not where the poses are: a drift of metres does not matter. A step is an outlier if its
    velocity differs too much from that of the newest step that was none, and from that of the step before, as given:
    where the poses go on from elsewhere, that step alone is one. The motion goes on steadily in its place, and the
    frame is that of the poses before. Times are in seconds after a stamp `first_ns`.
    """

    def __init__(self, settings: OdometrySettings) -> None:
        self._usual = np.array([settings.given_sigma_rotation, settings.given_sigma_translation]) ** 2
        self._limit = settings.outlier_speed  # m/s and rad/s
        self._stamps_ns: list[int] = []
        self._poses: list[Floats] = []  # T_first_sensor (4, 4), in the frame of the first poses
        self._variances: list[Floats] = []  # of the step to each pose (2,): of an angle, rad2, and of a coordinate, m2
        self._T_first_given = np.eye(4)
        self._velocity, self._step = np.zeros(6), np.zeros(6)  # of the newest step that was no outlier, and of any
        self._is_outlier, self._warned = False, False  # the former: the newest step

    def add(self, stamp_ns: int, T_given_sensor: Floats, step_covariance: Floats | None = None) -> None:
        """Adds a pose (4, 4), later than all before; `step_covariance` (6, 6) is that of the motion since the one
        before, rotation first, where it is known."""
        variance = self._usual
        if step_covariance is not None:
            known = np.array([np.trace(step_covariance[:3, :3]), np.trace(step_covariance[3:, 3:])]) / 3
            variance = np.maximum(known, _LEAST * self._usual)
        pose = self._T_first_given @ T_given_sensor
        if self._poses:
            seconds = (stamp_ns - self._stamps_ns[-1]) / NS
            before, self._step = self._step, np.asarray(velocity_between(self._poses[-1], pose, seconds))
            share = min(seconds / SENSOR.scan_seconds, 1.0)  # the velocity of a shorter step is that of its error
            # more than any that a carrier makes
            off = [share * (self._step - known).reshape(2, 3) for known in (self._velocity, before)]
            self._is_outlier = bool((np.linalg.norm(off, axis=2).max(axis=1) > self._limit).all())
            if self._is_outlier:
                self._warn(stamp_ns, seconds)
                pose = np.asarray(moved_on(self._poses[-1], self._velocity, seconds))
                variance = np.full(2, (self._limit * seconds) ** 2)
                self._T_first_given = squared_up(pose @ inverse(T_given_sensor))
            else:
                self._velocity = self._step
        self._stamps_ns.append(stamp_ns)
        self._poses.append(pose)
        self._variances.append(variance)
        old = bisect_left(self._stamps_ns, stamp_ns - _KEPT_NS)
        for values in (self._stamps_ns, self._poses, self._variances):
            del values[:old]  # type: ignore[attr-defined]

    def _warn(self, stamp_ns: int, seconds: float) -> None:
        """Warns of the first outlier."""
        if not self._warned:
            turn, metres = seconds * np.linalg.norm(self._step.reshape(2, 3), axis=1)
            _log.warning(
                "the given poses have a step of %.2f m and %.0f degrees at %.3f s, an outlier; such steps are ignored "
                "(reported once)",
                metres,
                np.degrees(turn),
                stamp_ns / NS,
            )
            self._warned = True

    def newest(self, point_times: Floats | None) -> Registration:
        """The registration of the scan of the newest pose, which is taken as it is; the scan is lost where the step to
        it is an outlier. Its points were measured `point_times` (N,) seconds after its stamp."""
        motion = steady_motion(self._poses[-1], self._velocity, 0.0, point_times)
        if self._is_outlier:
            covariance = np.diag(np.repeat(self._variances[-1], 3))
            return Registration(self._poses[-1], covariance, "lost", 0.0, motion, point_times)
        return Registration(self._poses[-1], _EXACT * np.eye(6), "good", 1.0, motion, point_times)

    def turned(self, begin_ns: int, end_ns: int) -> tuple[NDArray[np.int64], Floats] | None:
        """The stamps (N,) of the poses from before a time to after another, and the sum (N, 3) of all turns until each,
        rad; None where there is a gap."""
        known = slice(max(bisect_right(self._stamps_ns, begin_ns) - 1, 0), bisect_left(self._stamps_ns, end_ns) + 1)
        stamps = np.array(self._stamps_ns[known], np.int64)
        if len(stamps) < 2 or stamps[0] > begin_ns or stamps[-1] < end_ns or np.diff(stamps).max() > GAP_NS:
            return None
        R = Rotation.from_matrix(np.stack(self._poses[known])[:, :3, :3])
        return stamps, np.vstack([np.zeros(3), np.cumsum((R[:-1].inv() * R[1:]).as_rotvec(), axis=0)])

    def steps(self, first_ns: int, seconds: Floats) -> Steps:
        """The steps between knots at times (K,), as far as they are measured."""
        count = len(seconds) - 1
        poses, information = np.tile(np.eye(4), (count, 1, 1)), np.zeros((count, 2))
        for k in range(count):
            begin, end = (self._stamp_ns(first_ns, second) for second in seconds[k : k + 2])
            if self._is_measured(begin, end):
                poses[k] = self.between(first_ns, seconds[k], seconds[k + 1])
                information[k] = 1 / self._variance_of(begin, end)
        return Steps(poses, information)

    def tells(self, first_ns: int, begin: float, end: float) -> bool:
        """Whether there are poses near both times, so that the motion from one to the other is known."""
        ends = np.array([[self._stamp_ns(first_ns, second)] for second in (begin, end)])
        return len(self._poses) > 1 and bool(np.all(np.abs(ends - self._stamps_ns).min(axis=1) <= GAP_NS))

    def moved(self, first_ns: int, T: Floats, begin: float, seconds: Floats) -> Floats:
        """(K, 4, 4) the poses at times (K,) of a sensor that was at T (4, 4) at the time `begin`."""
        return np.stack([T @ self.between(first_ns, begin, second) for second in seconds])

    def between(self, first_ns: int, begin: float, end: float) -> Floats:
        """(4, 4) the motion from one time to another: T_begin_end of the sensor. Before the first pose and after the
        last the motion goes on steadily."""
        if len(self._poses) < 2:
            return np.eye(4)
        return inverse(self._at(self._stamp_ns(first_ns, begin))) @ self._at(self._stamp_ns(first_ns, end))

    def covariance(self, first_ns: int, begin: float, end: float) -> Floats:
        """(6, 6) of the motion from one time to another, rotation first: that of all its steps together."""
        low, high = self._stamp_ns(first_ns, begin), self._stamp_ns(first_ns, end)
        steps = self._variances[bisect_right(self._stamps_ns, low) : bisect_left(self._stamps_ns, high) + 1]
        return np.diag(np.repeat(np.sum([self._usual, *steps], axis=0), 3))

    def _stamp_ns(self, first_ns: int, second: float) -> int:
        return first_ns + round(second * NS)

    def _after(self, stamp_ns: int) -> int:
        """The index of the pose after a stamp, which has one before it."""
        return min(max(bisect_left(self._stamps_ns, stamp_ns), 1), len(self._stamps_ns) - 1)

    def _at(self, stamp_ns: int) -> Floats:
        """T_given_sensor (4, 4) at a stamp."""
        after = self._after(stamp_ns)
        begin, lasted = self._stamps_ns[after - 1], (self._stamps_ns[after] - self._stamps_ns[after - 1]) / NS
        velocity = velocity_between(self._poses[after - 1], self._poses[after], lasted)
        return np.asarray(moved_on(self._poses[after - 1], velocity, (stamp_ns - begin) / NS))

    def _is_measured(self, begin_ns: int, end_ns: int) -> bool:
        """Whether there are poses at both ends of a step, or near them, and none is far from the next."""
        if len(self._poses) < 2:
            return False
        stamps = self._stamps_ns[self._after(begin_ns) - 1 : self._after(end_ns) + 1]
        lasted = np.diff(stamps)
        beyond = max(stamps[0] - begin_ns, end_ns - stamps[-1])
        return bool(lasted.max() <= GAP_NS and beyond <= _BEYOND * lasted[-1])

    def _variance_of(self, begin_ns: int, end_ns: int) -> Floats:
        """(2,) rad2 and m2, of a step: its share of those given."""
        after = self._after((begin_ns + end_ns) // 2)
        return self._variances[after] * ((end_ns - begin_ns) / (self._stamps_ns[after] - self._stamps_ns[after - 1]))
