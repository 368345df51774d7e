"""The odometry that the settings name."""

from sgslam.config import OdometrySettings
from sgslam.odometry.base import Odometry

METHODS = ("kiss", "small_gicp")  # of `OdometrySettings.method`


def make_odometry(settings: OdometrySettings) -> Odometry:
    """The odometry of `settings.method`; raises UserError where its library is missing."""
    if settings.method == "small_gicp":
        from sgslam.odometry.small_gicp import SmallGicpOdometry

        return SmallGicpOdometry(settings)
    from sgslam.odometry.kiss import KissOdometry

    return KissOdometry(settings)
