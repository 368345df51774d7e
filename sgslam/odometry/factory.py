"""Creates the odometry named in the settings."""

from functools import partial
from typing import get_args

from sgslam.config import OdometrySettings, TrackingSettings
from sgslam.inertial import ImuBuffer, MeasuredMotion
from sgslam.odometry.base import Odometry
from sgslam.odometry.continuous_time import ContinuousTimeOdometry
from sgslam.odometry.given_motion import GivenMotion
from sgslam.odometry.timed import TimedOdometry

METHODS: tuple[str, ...] = get_args(OdometrySettings.model_fields["method"].annotation)


def make_odometry(
    odometry: OdometrySettings, tracking: TrackingSettings, imu: ImuBuffer | None = None,
    given: GivenMotion | None = None,
) -> Odometry:  # fmt: skip
    """Creates the odometry of `odometry.method`, which finds out the times of points that are not given as
    `tracking.point_times` says. Our own takes the motion from an `imu`, where there is one, and that `given` by
    another system. Raises UserError if a library is missing."""
    return TimedOdometry(partial(_make, odometry, tracking, imu, given), tracking.point_times, tracking.stamp)


def _make(
    odometry: OdometrySettings, tracking: TrackingSettings, imu: ImuBuffer | None, given: GivenMotion | None
) -> Odometry:
    if odometry.method == "small_gicp":
        from sgslam.odometry.small_gicp import SmallGicpOdometry

        return SmallGicpOdometry(odometry)
    if odometry.method == "kiss":
        from sgslam.odometry.kiss import KissOdometry

        return KissOdometry(odometry)
    return ContinuousTimeOdometry(tracking, None if imu is None else MeasuredMotion(imu), given)
