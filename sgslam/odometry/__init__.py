"""Odometry: KISS-ICP and small_gicp behind one interface, or external poses."""

from sgslam.odometry.base import Odometry
from sgslam.odometry.factory import METHODS, make_odometry

__all__ = ["METHODS", "Odometry", "make_odometry"]
