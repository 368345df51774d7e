"""Creates the odometry named in the settings."""

from typing import get_args

from sgslam.config import OdometrySettings
from sgslam.odometry.base import Odometry

METHODS: tuple[str, ...] = get_args(OdometrySettings.model_fields["method"].annotation)


def make_odometry(settings: OdometrySettings) -> Odometry:
    """Creates the odometry of `settings.method`; raises UserError if its library is missing."""
    if settings.method == "small_gicp":
        from sgslam.odometry.small_gicp import SmallGicpOdometry

        return SmallGicpOdometry(settings)
    from sgslam.odometry.kiss import KissOdometry

    return KissOdometry(settings)
