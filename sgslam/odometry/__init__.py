"""Odometry: our own in continuous time, KISS-ICP and small_gicp behind one interface, or given poses."""

from sgslam.odometry.base import Odometry
from sgslam.odometry.factory import METHODS, make_odometry

__all__ = ["METHODS", "Odometry", "make_odometry"]
