"""What else than registration tells how the sensor moves: an IMU, poses that come with scans, another odometry."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from data import UserError
from data.imu import ImuSamples
from sgslam.config import Config
from sgslam.geometry.frames import is_rigid
from sgslam.inertial import ImuBuffer
from sgslam.odometry import Odometry, make_odometry
from sgslam.odometry.given_motion import GivenMotion
from sgslam.tracking.clock_offset import ClockOffset
from sgslam.types import RawScan, TrackedScan

Floats = NDArray[np.float64]


class OtherMotion:
    """`imu` and `given` hold the newest samples and poses; `measured` is the latter where they enter registration, None
    where they replace it. `odometry` is one of others; its poses are taken as those that come with scans."""

    def __init__(self, config: Config, odometry: Odometry | None) -> None:
        self.imu, self.given = ImuBuffer(config.imu), GivenMotion(config.odometry)
        self.measured = self.given if config.odometry.given == "measured" else None
        self._odometry = odometry or make_odometry(config)
        self._clock = ClockOffset()
        self._come_with_poses: bool | None = None  # the scans; None before the first

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

    def located(self, raw: RawScan) -> RawScan:
        """Takes the pose of a scan, that of another odometry where it comes without; returns the scan with a pose only
        where this replaces registration.

        Raises UserError where only some scans come with poses: these are in another frame than the odometry's.
        """
        has_pose = raw.T_odom_sensor is not None
        may_lack = self.measured is not None and self._odometry is None
        if self._come_with_poses not in (None, has_pose) and not may_lack:
            raise UserError(
                f"scan at {raw.stamp_ns} ns: has {'a' if has_pose else 'no'} T_odom_sensor, unlike those before; give "
                "it for all scans or for none, or set odometry.given=measured (with odometry.method=continuous_time)"
            )
        self._come_with_poses = has_pose
        pose = raw.T_odom_sensor
        if pose is None and self._odometry is not None:
            pose = self._odometry.locate(raw.stamp_ns, raw.points, raw.point_times)
            if not is_rigid(pose):
                raise UserError(f"scan at {raw.stamp_ns} ns: the odometry's pose must be a finite rigid motion (4, 4)")
        if pose is None:
            return raw
        self.given.add(raw.stamp_ns, pose, raw.step_covariance)
        if self.measured is not None:
            return replace(raw, T_odom_sensor=None, step_covariance=None)
        return replace(raw, T_odom_sensor=pose)

    def compare_clock(self, scan: TrackedScan) -> None:
        """Compares how a scan turned with how it was measured elsewhere."""
        has_imu = self.imu.newest_ns is not None
        other, name = (self.imu, "the IMU") if has_imu else (self.given, "the given poses")
        if scan.health != "lost" and (has_imu or self.measured is not None):
            self._clock.add(scan.raw.stamp_ns, scan.T_odom_sensor[:3, :3], other, name)
        else:
            self.interrupt()

    def interrupt(self) -> None:
        """To be called where the next scan's attitude does not follow from the last one's."""
        self._clock.lose()

    @property
    def advice(self) -> str | None:
        """A line where the clock of what else measures the motion proves wrong, else None."""
        return self._clock.advice
