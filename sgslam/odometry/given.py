"""Poses that an external odometry gives, scan by scan."""

import logging
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sgslam.config import OdometrySettings
from sgslam.geometry.frames import angle_of, inverse, squared_up
from sgslam.odometry.base import State
from sgslam.odometry.rigid import steady_motion
from sgslam.registration import Registration
from sgslam.registration.motion_prior import moved_on, velocity_between

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
_FAST, _TURNING = 5.0, 3.0  # m/s and rad/s, the fastest that a sensor is carried indoors
_OUTLIER_SPEED, _OUTLIER_TURN = 10.0, 5.0  # m/s and rad/s, standard deviations of a step that was an outlier
_LONGEST_OUTLIER_NS = 10**9  # a deviation that lasts is no slip: the robot was stopped or pushed


class GivenPoses:
    """Takes each given pose as registration of its scan, unless the step to it is an outlier.

    A step is an outlier if it differs too much from the one that the last velocity predicts, or is too long where that
    is not known. The predicted pose is then returned, and the scan is lost. One scan later the external odometry may
    have recovered, or it slipped and goes on from there: the closer one is taken. So the frame never jumps.
    """

    _STATE = ("_pose", "_velocity", "_stamp_ns", "_interval_ns", "_shift", "_before", "_outlier_ns", "_warned")

    def __init__(self, settings: OdometrySettings) -> None:
        self._settings = settings
        self._pose: Floats | None = None  # T_odom_sensor of the newest scan
        self._velocity = np.zeros(6)
        self._stamp_ns, self._interval_ns = 0, 0
        self._shift, self._before = np.eye(4), np.eye(4)  # T_odom_given now, and before the last outliers
        self._outlier_ns = 0  # for how long steps have been outliers
        self._warned = False

    @property
    def has_begun(self) -> bool:
        """Whether a pose was given."""
        return self._pose is not None

    def register(self, stamp_ns: int, T_given_sensor: Floats, point_times: Floats | None = None) -> Registration:
        """The registration of a scan at a given pose (4, 4), points measured `point_times` (N,) seconds after it."""
        if self._pose is None:
            self._pose, self._stamp_ns = T_given_sensor.copy(), stamp_ns
            motion = steady_motion(self._pose, self._velocity, 0.0, point_times)
            return Registration(self._pose, np.eye(6) * 1e-8, "good", 1.0, motion, point_times)
        interval_ns = max(stamp_ns - self._stamp_ns, 1)
        predicted = np.asarray(moved_on(self._pose, self._velocity, interval_ns / 1e9))
        pose, outlier = self._checked(T_given_sensor, predicted, interval_ns)
        if outlier is None:
            self._outlier_ns = 0
            self._velocity = np.asarray(velocity_between(self._pose, pose, interval_ns / 1e9))
        else:
            self._warn(outlier, stamp_ns)
            self._outlier_ns += interval_ns
            self._shift = squared_up(pose @ inverse(T_given_sensor))
        self._pose, self._stamp_ns, self._interval_ns = pose, stamp_ns, interval_ns
        motion = steady_motion(pose, self._velocity, 0.0, point_times)
        covariance = self._covariance(interval_ns / 1e9, outlier is not None)
        if outlier is None:
            return Registration(pose, covariance, "good", 1.0, motion, point_times)
        return Registration(pose, covariance, "lost", 0.0, motion, point_times)

    def _checked(
        self, T_given_sensor: Floats, predicted: Floats, interval_ns: int
    ) -> tuple[Floats, tuple[float, float] | None]:
        """The pose (4, 4) of a scan, and the size (m, rad) of the outlier if its step is one."""
        assert self._pose is not None
        poses = {"on": squared_up(self._shift @ T_given_sensor), "back": squared_up(self._before @ T_given_sensor)}
        best = min(poses, key=lambda name: sum(_apart(predicted, poses[name])))
        outlier = self._outlier_size(poses[best], predicted, interval_ns)
        if outlier is not None and self._outlier_ns < _LONGEST_OUTLIER_NS:
            return predicted, outlier
        if best == "back":
            self._shift = self._before
        elif not self._outlier_ns:
            self._before = self._shift
        return poses[best], None

    def _outlier_size(self, pose: Floats, predicted: Floats, interval_ns: int) -> tuple[float, float] | None:
        """The size (m, rad) of an outlier step; None where the step is plausible."""
        assert self._pose is not None
        settings, seconds = self._settings, interval_ns / 1e9
        if 2 * self._interval_ns < 3 * interval_ns < 4.5 * self._interval_ns:
            farthest, widest, size = settings.outlier_distance, settings.outlier_angle, _apart(predicted, pose)
        else:  # the speed is not known
            farthest, widest = max(settings.max_step, _FAST * seconds), max(settings.max_turn, _TURNING * seconds)
            size = _apart(self._pose, pose)
        return None if size[0] < farthest and size[1] < widest else size

    def _covariance(self, seconds: float, is_outlier: bool) -> Floats:
        """(6, 6) of the pose against the one before, rotation first."""
        settings = self._settings
        turn = _OUTLIER_TURN if is_outlier else settings.external_turn_error
        speed = _OUTLIER_SPEED if is_outlier else settings.external_speed_error
        return np.diag(np.repeat([turn * seconds, speed * seconds], 3) ** 2)

    def _warn(self, outlier: tuple[float, float], stamp_ns: int) -> None:
        """Warns of the first outlier."""
        if not self._warned:
            _log.warning(
                "the external odometry has an outlier of %.2f m and %.0f degrees at %.3f s; such steps are ignored "
                "(reported once)", outlier[0], np.degrees(outlier[1]), stamp_ns / 1e9,
            )  # fmt: skip
            self._warned = True

    def state(self) -> dict[str, Any]:
        """See `Odometry.state`."""
        return {name: getattr(self, name) for name in self._STATE}

    def restore(self, state: State) -> None:
        """See `Odometry.restore`."""
        for name in self._STATE:
            setattr(self, name, state[name])


def _apart(T_a: Floats, T_b: Floats) -> tuple[float, float]:
    """Metres and radians between two poses (4, 4)."""
    between = inverse(T_a) @ T_b
    return float(np.linalg.norm(between[:3, 3])), angle_of(between)
