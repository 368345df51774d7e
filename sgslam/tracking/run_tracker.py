"""Tracks all scans of a run, and starts again where the sensor was carried elsewhere. It knows nothing of the map."""

from copy import deepcopy
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from data import UserError
from data.imu import ImuSamples
from sgslam.config import Config
from sgslam.inertial import ImuBuffer
from sgslam.odometry import Odometry, make_odometry
from sgslam.odometry.given_motion import GivenMotion
from sgslam.perception import RawScan, checked_scan
from sgslam.tracking.clock_offset import ClockOffset
from sgslam.tracking.scan_tracker import ScanTracker, TrackedScan

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class CarriedElsewhere:
    """The sensor was carried elsewhere: with the scan at `since_ns` another frame `odom` begins, and another map."""

    since_ns: int


TrackingStep: TypeAlias = TrackedScan | CarriedElsewhere


class RunTracker:
    """The tracker of a run: raw scans in, steps for the map out.

    The map may be elsewhere, in another process for instance: nothing comes back from it. `odometry` is that of the
    settings by default. `imu` holds the newest samples of an IMU, none without one. `newest_ns` is the stamp of the
    newest scan, None before the first.
    """

    def __init__(self, config: Config, odometry: Odometry | None = None) -> None:
        self._config, self._given_odometry = config, odometry
        self._fresh = None if odometry is None else _state_of(odometry)
        self.imu = ImuBuffer(config.imu)
        own = odometry is None and config.odometry.method == "continuous_time"
        self._given_motion = GivenMotion(config.odometry) if own and config.odometry.given == "measured" else None
        self._clock = ClockOffset()
        self.newest_ns: int | None = None
        self._tracker = self._begin()
        self._kept: list[TrackedScan] = []  # the newest scans, while they are lost or unconfirmed
        self._advice: list[str] = []  # of the trackers before

    def track(
        self, stamp_ns: int, points: NDArray[np.floating[Any]], point_times: Floats | None = None,
        T_odom_sensor: Floats | None = None, step_covariance: Floats | None = None,
    ) -> list[TrackingStep]:  # fmt: skip
        """The steps that a scan settles: none in the first seconds, until it is known where up is, then all at once.

        The arguments and what is raised are those of `SceneGraphSlam.add_scan`.
        """
        raw = checked_scan(stamp_ns, points, point_times, T_odom_sensor, step_covariance, self.newest_ns)
        if self._given_motion is None:
            self._check_same_frame(raw)
        elif raw.T_odom_sensor is not None:
            self._given_motion.add(raw.stamp_ns, raw.T_odom_sensor, raw.step_covariance)
            raw = replace(raw, T_odom_sensor=None, step_covariance=None)  # it is registered
        steps = self._tracked(raw)
        self.newest_ns = raw.stamp_ns
        kept = self._tracker.waiting or [scan.raw for scan in self._kept] or [raw]
        self.imu.forget(kept[0].stamp_ns)
        return steps

    def _check_same_frame(self, raw: RawScan) -> None:
        """Raises UserError where only some scans have poses: these are in another frame than the odometry's."""
        if self.newest_ns is not None and self._tracker.follows_given == (raw.T_odom_sensor is None):
            given = "has no T_odom_sensor" if raw.T_odom_sensor is None else "has a T_odom_sensor"
            raise UserError(
                f"scan at {raw.stamp_ns} ns: {given}, unlike those before; give it for all scans or for none, or set "
                "odometry.given=measured (with odometry.method=continuous_time)"
            )

    def release(self) -> list[TrackingStep]:
        """The steps of all scans that wait."""
        steps: list[TrackingStep] = []
        while self.newest_ns is not None and (waiting := self._tracker.release()):
            steps += self._judged(waiting)
        return steps

    def add_imu(self, stamp_ns: int | NDArray[np.int64], gyro: Floats, accel: Floats) -> None:
        """See `SceneGraphSlam.add_imu`."""
        stamps = np.atleast_1d(np.asarray(stamp_ns, np.int64))
        newest = self.imu.newest_ns
        try:
            samples = ImuSamples(
                stamps, np.atleast_2d(np.asarray(gyro, float)), np.atleast_2d(np.asarray(accel, float))
            )
        except ValueError as error:
            raise UserError(f"{error}; give (3,) of each in rad/s and m/s2, in the order of their stamps") from None
        if newest is not None and len(stamps) and stamps[0] <= newest:
            raise UserError(f"IMU at {stamps[0]} ns: stamps must increase; the last was {newest} ns")
        if len(stamps):
            self.imu.add(samples)

    @property
    def waiting(self) -> Floats | None:
        """(4, 4) T_odom_sensor of the newest scan that waits until it is known where up is, as far as known; None if
        none does."""
        return self._tracker.newest

    @property
    def advice(self) -> list[str]:
        """Lines where the stated mount, or the clock of what else measures the motion, proves wrong."""
        return [*self._advice, *(line for line in (self._tracker.advice, self._clock.advice) if line)]

    @property
    def is_way_up_assumed(self) -> bool:
        """Whether nothing but the usual mount says that the sensor does not hang upside down."""
        return self._tracker.is_way_up_assumed

    def times_of(self, points: Floats, point_times: Floats | None) -> Floats | None:
        """(N,) the times of a scan's points (N, 3), told or not, by what is known now; None for a snapshot."""
        times = None if point_times is None else np.asarray(point_times, np.float64)
        return self._tracker.times_of(points, times)

    def _begin(self) -> ScanTracker:
        """A new tracker, with a new odometry unless the caller passed one."""
        config, given = self._config, self._given_motion
        odometry = self._given_odometry or make_odometry(config.odometry, config.tracking, self.imu, given)
        return ScanTracker(config, odometry, self.imu, given)

    def _tracked(self, raw: RawScan) -> list[TrackingStep]:
        return self._judged(self._tracker.track(raw))

    def _judged(self, tracked: list[TrackedScan]) -> list[TrackingStep]:
        """Tracked scans as steps, up to the one that shows that the sensor was carried elsewhere."""
        steps: list[TrackingStep] = []
        for number, found in enumerate(tracked):
            scan = self._tracker.confirmed(found)
            if self._tracker.was_carried_elsewhere(scan) and self._can_begin_again(scan):
                return [*steps, *self._begin_elsewhere(tracked[number:])]
            self._kept = [*self._kept, scan] if scan.waits else []
            self._compare_clocks(scan)
            steps.append(scan)
        return steps

    def _compare_clocks(self, scan: TrackedScan) -> None:
        has_imu = self.imu.newest_ns is not None
        other, name = (self.imu, "the IMU") if has_imu else (self._given_motion, "the given poses")
        if other is not None and scan.health != "lost":
            self._clock.add(scan.raw.stamp_ns, scan.T_odom_sensor[:3, :3], other, name)
        else:
            self._clock.lose()

    def _can_begin_again(self, scan: TrackedScan) -> bool:
        """Whether the odometry can forget its scans; one that cannot goes on, and never gets an old scan."""
        return self._given_odometry is None or self._fresh is not None or scan.raw.T_odom_sensor is not None

    def _begin_elsewhere(self, newest: list[TrackedScan]) -> list[TrackingStep]:
        """Tracks the scans since the sensor was carried elsewhere, and the `newest` ones, from the beginning."""
        since_ns = self._tracker.carried_since_ns
        again = [scan.raw for scan in (*self._kept, *newest) if scan.raw.stamp_ns >= since_ns]
        self._advice = [*self._advice, *([line] if (line := self._tracker.advice) else [])]
        if self._given_odometry is not None and self._fresh is not None:
            self._given_odometry.restore(deepcopy(self._fresh))
        self._tracker, self._kept = self._begin(), []
        self._clock.lose()
        steps: list[TrackingStep] = [CarriedElsewhere(since_ns)]
        for raw in again:
            steps += self._tracked(raw)
        return steps

    def state(self) -> dict[str, Any]:
        """The complete state as a tree (see `state_tree`); not a copy."""
        return {
            "newest_ns": self.newest_ns, "kept": self._kept, "advice": self._advice, "imu": self.imu.state(),
            "tracker": self._tracker.state(), "clock": self._clock.state(),
            "given": None if self._given_motion is None else self._given_motion.state(),
        }  # fmt: skip

    def restore(self, state: dict[str, Any]) -> None:
        """Restores a tree that `state` returned. Raises KeyError, TypeError or ValueError if it does not fit."""
        self.imu.restore(state["imu"])
        if self._given_motion is not None:
            self._given_motion.restore(state["given"])
        self._tracker = self._begin()
        self._tracker.restore(state["tracker"])
        self._clock.restore(state["clock"])
        self.newest_ns, self._kept, self._advice = state["newest_ns"], state["kept"], state["advice"]


def _state_of(odometry: Odometry) -> dict[str, Any] | None:
    """A copy of its state; None where it has none, such as one that stands in where all scans come with poses."""
    try:
        return deepcopy(odometry.state())
    except (AttributeError, NotImplementedError):
        return None
