"""Tracks scan after scan: each is registered by the odometry, in a frame that is level and never jumps."""

import logging
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sgslam.config import Config
from sgslam.geometry.frames import inverse
from sgslam.inertial import ImuBuffer, MeasuredMotion, measured_up
from sgslam.odometry.continuous_time import ContinuousTimeOdometry
from sgslam.odometry.given_motion import GivenMotion
from sgslam.odometry.timed import TimedOdometry
from sgslam.serialization import Stateful
from sgslam.tracking.level_frame import LevelFrame
from sgslam.tracking.lost_sensor import LostSensor
from sgslam.types import RawScan, Registration, TrackedScan

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)


class ScanTracker(Stateful):
    """Tracks the pose of each scan. The frame `odom` is level, with the first pose's place and heading.

    What the graph knows better, by the plan and by loops, acts as T_map_odom and never moves `odom`.
    """

    _STATE = ("waiting", "_found", "_T_level_source")

    def __init__(self, config: Config, imu: ImuBuffer, given: GivenMotion) -> None:
        """`given` has the poses of another system so far, if there is one."""
        self._config, self._imu, self._given = config, imu, given
        self._odometry = self._another()
        self._level = LevelFrame(config.tracking)
        self._lost = LostSensor(config.tracking, self._another)
        # until it is known where up is, and what the points' times are: scans, and their poses as of now
        self.waiting: list[RawScan] = []
        self._found: list[Registration] = []
        self._T_level_source = np.eye(4)  # from the frame in which poses come
        self._odometry.level(self._level.likely_up)  # as the mount says, until the surfaces do
        self._odometry.hold()

    def track(self, raw: RawScan) -> list[TrackedScan]:
        """The newest scans whose poses are known: none in the first seconds, until up is known, then all."""
        if raw.T_odom_sensor is None:
            found = self._odometry.register(raw.stamp_ns, raw.points, raw.point_times)
        else:
            found = self._given.newest(raw.point_times)
        if self._level.known:
            return [self._tracked(raw, found)]
        self.waiting.append(raw)
        self._found = self._odometry.held if raw.T_odom_sensor is None else [*self._found, found]
        self._level.add(self.waiting, self._found, self._measured_up())
        self._odometry.level(self._level.likely_up)
        return self.release() if self._is_settled(raw) else []

    def _measured_up(self) -> Floats | None:
        """(3,) up by the accelerometer in the frame of the first pose, once it shows more than the carrier's steps."""
        T_first_odom = inverse(self._found[0].T_odom_sensor)
        poses = np.stack([T_first_odom @ result.T_odom_sensor for result in self._found])
        return measured_up(self._imu, np.array([raw.stamp_ns for raw in self.waiting]), poses)

    def _is_settled(self, raw: RawScan) -> bool:
        """Whether it is known where up is and what the points' times are, or it has been too long."""
        if raw.stamp_ns - self.waiting[0].stamp_ns >= 1e9 * self._config.tracking.gravity_until:
            return True
        if raw.T_odom_sensor is None and self._odometry.kind is None:
            return False
        return self._level.sure

    def release(self) -> list[TrackedScan]:
        """The scans that wait; if up is not known yet, it is where the mount says."""
        if not self._level.known:
            self._found = self._odometry.release() or self._found  # the latter where poses are given
            self._level.settle(self.waiting, self._found)
            self._T_level_source = self._T_level_now()
            self._odometry.level(self._T_level_source[2, :3])
        waiting, found = self.waiting, self._found
        self.waiting, self._found = [], []
        return [self._tracked(*scan) for scan in zip(waiting, found, strict=True)]

    @property
    def advice(self) -> str | None:
        """A line where the stated mount proves wrong, else None."""
        return self._level.advice

    @property
    def is_way_up_assumed(self) -> bool:
        """Whether nothing but the usual mount says that the sensor does not hang upside down."""
        return self._level.is_way_up_assumed

    @property
    def newest(self) -> Floats | None:
        """(4, 4) T_odom_sensor of the newest scan that waits, as far as known; None if none does."""
        return self._T_level_now() @ self._found[-1].T_odom_sensor if self.waiting else None

    def _T_level_now(self) -> Floats:  # noqa: N802
        """(4, 4) from the frame in which poses come, as far as it is known where up is."""
        if not self._found:
            return np.eye(4)
        return self._level.T_level_first @ inverse(self._found[0].T_odom_sensor)

    def _tracked(self, raw: RawScan, found: Registration) -> TrackedScan:
        return TrackedScan(raw, found, self._T_level_source @ found.T_odom_sensor)

    def judged(self, scan: TrackedScan) -> tuple[TrackedScan, int | None]:
        """The scan, marked as unconfirmed where the sensor was lost for longer and found again not long ago, and the
        stamp since which the sensor is elsewhere, None where it is not: see `LostSensor`. To be asked for each scan."""
        raw = scan.raw
        if raw.T_odom_sensor is not None:  # which says where the sensor is
            return scan, None
        if scan.health == "lost":
            return scan, self._lost.lose(raw, scan.registration.is_after_pause, self._odometry)
        unconfirmed, since_ns = self._lost.see(raw.stamp_ns, scan.registration.is_after_pause)
        return replace(scan, unconfirmed=unconfirmed), since_ns

    def _another(self) -> TimedOdometry:
        """An odometry that knows of no scan yet."""
        settings = self._config.tracking
        measured = self._given if self._config.odometry.given == "measured" else None

        def make() -> ContinuousTimeOdometry:
            return ContinuousTimeOdometry(settings, MeasuredMotion(self._imu), measured)

        return TimedOdometry(make, settings.point_times, settings.stamp)

    def state(self) -> dict[str, Any]:
        """See `Stateful`; with the state of its parts."""
        return {
            **super().state(),
            "odometry": self._odometry.state(),
            "level": self._level.state(),
            "lost": self._lost.state(),
        }

    def restore(self, state: dict[str, Any]) -> None:
        """See `Stateful`."""
        super().restore(state)
        self._odometry.restore(state["odometry"])
        self._level.restore(state["level"])
        self._lost.restore(state["lost"])
