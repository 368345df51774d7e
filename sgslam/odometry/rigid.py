"""What odometries share that register each scan as one rigid body, deskewed to its end."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sgslam.config import OdometrySettings
from sgslam.geometry.frames import inverse
from sgslam.odometry.base import Odometry, State
from sgslam.odometry.steps import plausible
from sgslam.registration import Motion, Registration
from sgslam.registration.motion_prior import moved_on, velocity_between

Floats = NDArray[np.float64]
_LONGEST_STEADY = 0.5  # s; after a longer gap between scans the motion is unknown
_SUSPICIOUS = 0.8  # of the usual share of points on the map; below it, a scan is searched
_USUAL_SCANS = 10  # for which the usual share is remembered
_SHORTEST = 1e-3  # s; a shorter scan is a snapshot


@dataclass(frozen=True, eq=False)
class Fit:
    """A scan on the local map: the pose `T` (4, 4) at its end, the share of its points on the map, their mean distance
    from it, and the pose's covariance (6, 6), rotation first, in the sensor's axes."""

    T: Floats
    share: float
    residual: float
    covariance: Floats


class RigidOdometry(ABC):
    """The pose at the end of each scan and the velocity (6,) since the scan before, which goes on through the scan."""

    _STATE: tuple[str, ...] = ("_last", "_velocity", "_ended_ns", "_unseen", "_scans", "_usual", "residual")

    def __init__(self, settings: OdometrySettings) -> None:
        self._settings = settings
        self._last, self._velocity = np.eye(4), np.zeros(6)
        self._ended_ns, self._scans = 0, 0
        self._unseen = 0.0  # s, since the last scan that fitted
        self._usual = 0.0  # share of a scan's points on the map
        self.residual = np.inf  # mean distance of the newest scan's points from the local map

    @abstractmethod
    def _fit(self, points: Floats, point_times: Floats | None, predicted: Floats, seconds: float) -> Fit | None:
        """Registers a scan that ends so many seconds after the one before, near its `predicted` pose (4, 4), and lets
        the local map grow; None where it does not fit."""

    def register(self, stamp_ns: int, points: Floats, point_times: Floats | None = None) -> Registration:
        """See `Odometry.register`."""
        end = end_of(point_times)
        ended_ns = stamp_ns + round(end * 1e9)
        seconds = max(ended_ns - self._ended_ns, 1) / 1e9 if self._scans else 0.0
        predicted = np.asarray(moved_on(self._last, self._velocity, min(seconds, _LONGEST_STEADY)))
        fit = self._fit(points, point_times, predicted, seconds)
        pose = predicted if fit is None else fit.T
        if self._scans:
            self._velocity = np.asarray(velocity_between(self._last, pose, seconds))
        self._last, self._ended_ns, self._scans = pose, ended_ns, self._scans + 1
        self._unseen = self._unseen + seconds if fit is None else 0.0
        motion = steady_motion(pose, self._velocity, end, point_times)
        T_odom_sensor = np.asarray(moved_on(pose, self._velocity, -end))
        if fit is None:
            return Registration(T_odom_sensor, self._drift(self._unseen), "lost", 0.0, motion, point_times)
        self.residual = fit.residual
        self._usual += (fit.share - self._usual) / min(self._scans, _USUAL_SCANS)
        return Registration(T_odom_sensor, fit.covariance, "good", fit.share, motion, point_times)

    def _is_sure(self, fit: Fit | None) -> bool:
        """Whether a scan fits as well as usual, after a plausible step."""
        if fit is None or fit.share < max(self._settings.min_share, _SUSPICIOUS * self._usual):
            return False
        return plausible(inverse(self._last) @ fit.T, self._settings)

    def _drift(self, seconds: float) -> Floats:
        """The covariance (6, 6) of a pose that nothing has constrained for so many seconds."""
        errors = np.array([self._settings.unconstrained_turn_error, self._settings.unconstrained_speed_error])
        return np.diag(np.repeat(errors * seconds, 3) ** 2 + 1e-8)

    def level(self, up_in_odom: Floats) -> None:
        """See `Odometry.level`: a registration that assumes nothing of the motion has no use for it."""
        return

    def look_back(self, results: list[Registration]) -> list[Registration]:
        """See `Odometry.look_back`: results stay as they are."""
        return results

    def rejoin(self, other: Odometry) -> bool:
        """See `Odometry.rejoin`: lost scans are searched one by one."""
        return False

    def state(self) -> dict[str, Any]:
        """See `Odometry.state`."""
        return {name: getattr(self, name) for name in self._STATE}

    def restore(self, state: State) -> None:
        """See `Odometry.restore`."""
        for name in self._STATE:
            setattr(self, name, state[name])


def steady_motion(T_odom_sensor: Floats, velocity: Floats, at: float, point_times: Floats | None) -> Motion:
    """The motion during a scan with a steady velocity (6,), and the pose (4, 4) `at` seconds after its stamp."""
    if point_times is None or len(point_times) < 2 or np.ptp(point_times) < _SHORTEST:
        return Motion(np.zeros(1), np.asarray(moved_on(T_odom_sensor, velocity, -at))[None])
    seconds = np.array([point_times.min(), point_times.max()])
    return Motion(seconds, np.stack([moved_on(T_odom_sensor, velocity, s - at) for s in seconds]))


def end_of(point_times: Floats | None) -> float:
    """Seconds from a scan's stamp to its last point; 0 for a snapshot."""
    return 0.0 if point_times is None or not len(point_times) else float(point_times.max())
