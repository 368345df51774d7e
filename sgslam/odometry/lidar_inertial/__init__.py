"""LiDAR-inertial odometries of other projects, each an optional extra, behind the same interface."""

from sgslam.odometry.lidar_inertial.adapter import LidarInertialOdometry

__all__ = ["LidarInertialOdometry"]
