"""Tracks all scans of a run, and starts again where the sensor was carried elsewhere. It knows nothing of the map."""

import logging
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from data import UserError
from data.imu import ImuSamples
from sgslam.config import Config
from sgslam.geometry.frames import is_rigid
from sgslam.inertial import ImuBuffer
from sgslam.odometry import Odometry, make_odometry
from sgslam.odometry.given_motion import GivenMotion
from sgslam.perception import checked_scan
from sgslam.tracking.clock_offset import ClockOffset
from sgslam.tracking.scan_tracker import ScanTracker
from sgslam.types import RawScan, TrackedScan

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class CarriedElsewhere:
    """The sensor was carried elsewhere: with the scan at `since_ns` another frame `odom` begins, and another map."""

    since_ns: int


TrackingStep: TypeAlias = TrackedScan | CarriedElsewhere


@dataclass(frozen=True)
class TrackerNotes:
    """What the result of a run says of its tracking: lines of advice, whether nothing but the usual mount says that the
    sensor does not hang upside down, and whether there is an IMU."""

    advice: tuple[str, ...] = ()
    is_way_up_assumed: bool = False
    has_imu: bool = False


class RunTracker:
    """The tracker of a run: raw scans in, steps for the map out.

    The map may be elsewhere, in another process for instance: nothing comes back from it. `odometry` is that of the
    settings by default; its poses are taken as those that come with scans. `imu` holds the newest samples of an IMU,
    none without one. `newest_ns` is the stamp of the newest scan, None before the first.
    """

    def __init__(self, config: Config, odometry: Odometry | None = None) -> None:
        self._config, self._is_measured = config, config.odometry.given == "measured"
        self._odometry = odometry or make_odometry(config)  # of others
        self._come_with_poses: bool | None = None  # the scans; None before the first
        self.imu, self._given = ImuBuffer(config.imu), GivenMotion(config.odometry)
        self._clock = ClockOffset()
        self.newest_ns: int | None = None
        self._tracker = ScanTracker(config, self.imu, self._given)
        self._held: list[TrackedScan] = []  # the newest scans, while they are lost or unconfirmed
        self._advice: list[str] = []  # of the trackers before

    def track(
        self, stamp_ns: int, points: NDArray[np.floating[Any]], point_times: Floats | None = None,
        T_odom_sensor: Floats | None = None, step_covariance: Floats | None = None,
    ) -> list[TrackingStep]:  # fmt: skip
        """The steps that a scan settles: none in the first seconds, until it is known where up is, and none while the
        sensor is lost or unconfirmed, then all at once.

        The arguments and what is raised are those of `SceneGraphSlam.add_scan`.
        """
        raw = self._located(checked_scan(stamp_ns, points, point_times, T_odom_sensor, step_covariance, self.newest_ns))
        if raw.T_odom_sensor is not None:
            self._given.add(raw.stamp_ns, raw.T_odom_sensor, raw.step_covariance)
            if self._is_measured:
                raw = replace(raw, T_odom_sensor=None, step_covariance=None)  # it is registered
        steps = self._judged(self._tracker.track(raw))
        self.newest_ns = raw.stamp_ns
        kept = self._tracker.waiting or [scan.raw for scan in self._held] or [raw]
        self.imu.forget(kept[0].stamp_ns)
        return steps

    def _located(self, raw: RawScan) -> RawScan:
        """A scan that comes without a pose, with that of the odometry of others. Raises UserError where only some scans
        come with poses: these are in another frame than the odometry's."""
        has_pose = raw.T_odom_sensor is not None
        is_registered = self._is_measured and self._odometry is None
        if self._come_with_poses not in (None, has_pose) and not is_registered:
            raise UserError(
                f"scan at {raw.stamp_ns} ns: has {'a' if has_pose else 'no'} T_odom_sensor, unlike those before; give "
                "it for all scans or for none, or set odometry.given=measured (with odometry.method=continuous_time)"
            )
        self._come_with_poses = has_pose
        if has_pose or self._odometry is None:
            return raw
        pose = self._odometry.locate(raw.stamp_ns, raw.points, raw.point_times)
        if not is_rigid(pose):
            raise UserError(f"scan at {raw.stamp_ns} ns: the odometry's pose must be a finite rigid motion (4, 4)")
        return replace(raw, T_odom_sensor=pose)

    def release(self) -> list[TrackingStep]:
        """The steps of all scans that wait or are held back."""
        steps: list[TrackingStep] = []
        while self.newest_ns is not None and (waiting := self._tracker.release()):
            steps += self._judged(waiting)
        return [*steps, *self._released()]

    def _released(self) -> list[TrackedScan]:
        """The scans that were held back, the lost ones at their predicted poses: it is sure by now where the sensor is,
        or the run ends."""
        held, self._held = self._held, []
        lost = [scan.raw.stamp_ns / 1e9 for scan in held if scan.health == "lost"]
        if lost:
            _log.warning("scans at %.2f to %.2f s are lost: %d poses are predicted", lost[0], lost[-1], len(lost))
        return held

    @property
    def held(self) -> TrackedScan | None:
        """The newest scan, while it is held back as the sensor is lost, or was so long ago that it may be elsewhere."""
        return self._held[-1] if self._held else None

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
    def notes(self) -> TrackerNotes:
        """What is known so far."""
        return TrackerNotes(tuple(self.advice), self._tracker.is_way_up_assumed, self.imu.newest_ns is not None)

    def _judged(self, tracked: list[TrackedScan]) -> list[TrackingStep]:
        """Tracked scans as steps, up to the one that shows that the sensor was carried elsewhere."""
        steps: list[TrackingStep] = []
        for number, found in enumerate(tracked):
            scan, since_ns = self._tracker.judged(found)
            if since_ns is not None:
                return [*steps, *self._begin_elsewhere(since_ns, tracked[number:])]
            self._compare_clocks(scan)
            self._held.append(scan)
            if not scan.waits:
                steps += self._released()
        return steps

    def _compare_clocks(self, scan: TrackedScan) -> None:
        has_imu = self.imu.newest_ns is not None
        other, name = (self.imu, "the IMU") if has_imu else (self._given, "the given poses")
        if scan.health != "lost" and (has_imu or self._is_measured):
            self._clock.add(scan.raw.stamp_ns, scan.T_odom_sensor[:3, :3], other, name)
        else:
            self._clock.lose()

    def _begin_elsewhere(self, since_ns: int, newest: list[TrackedScan]) -> list[TrackingStep]:
        """Tracks the scans since the sensor was carried elsewhere, and the `newest` ones, from the beginning."""
        again = [scan.raw for scan in (*self._held, *newest) if scan.raw.stamp_ns >= since_ns]
        self._held = [scan for scan in self._held if scan.raw.stamp_ns < since_ns]  # they stay with the map before
        steps: list[TrackingStep] = [*self._released(), CarriedElsewhere(since_ns)]
        self._advice = [*self._advice, *([line] if (line := self._tracker.advice) else [])]
        self._tracker = ScanTracker(self._config, self.imu, self._given)
        self._clock.lose()
        for raw in again:
            steps += self._judged(self._tracker.track(raw))
        return steps

    def state(self) -> dict[str, Any]:
        """The complete state as a tree (see `state_tree`); not a copy."""
        return {
            "newest_ns": self.newest_ns, "held": self._held, "advice": self._advice, "imu": self.imu.state(),
            "tracker": self._tracker.state(), "clock": self._clock.state(), "given": self._given.state(),
            "odometry": None if self._odometry is None else self._odometry.state(), "posed": self._come_with_poses,
        }  # fmt: skip

    def restore(self, state: dict[str, Any]) -> None:
        """Restores a tree that `state` returned. Raises KeyError, TypeError or ValueError if it does not fit."""
        self.imu.restore(state["imu"])
        self._given.restore(state["given"])
        if self._odometry is not None:
            self._odometry.restore(state["odometry"])
        self._come_with_poses = state["posed"]
        self._tracker = ScanTracker(self._config, self.imu, self._given)
        self._tracker.restore(state["tracker"])
        self._clock.restore(state["clock"])
        self.newest_ns, self._held, self._advice = state["newest_ns"], state["held"], state["advice"]
