"""Stamped poses, and the files that hold them."""

from data.trajectory.trajectory import Trajectory

__all__ = ["Trajectory"]
