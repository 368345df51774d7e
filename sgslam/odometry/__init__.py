"""Odometry: our own in continuous time and those of other projects behind one interface, or given poses."""

from sgslam.odometry.base import Odometry
from sgslam.odometry.factory import METHODS, make_odometry

__all__ = ["METHODS", "Odometry", "make_odometry"]
