"""Odometry behind one interface: KISS-ICP, small_gicp, or poses from outside."""

from sgslam.odometry.base import Odometry
from sgslam.odometry.factory import METHODS, make_odometry

__all__ = ["METHODS", "Odometry", "make_odometry"]
