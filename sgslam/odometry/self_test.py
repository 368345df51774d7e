"""A small job that compiles the loops of the odometry."""

import numpy as np
from numpy.typing import NDArray

from sgslam.config import TrackingSettings
from sgslam.odometry.continuous_time import ContinuousTimeOdometry

_ROOM = np.array([3.0, 4.0, 1.5])  # m, from the sensor in its middle to the walls and the ceiling
_PERIOD = 100_000_000  # ns between scans


def register() -> None:
    """Registers three scans of a room, so that the loops are loaded or compiled before a robot needs them."""
    odometry = ContinuousTimeOdometry(TrackingSettings())
    for number in range(3):
        odometry.register(number * _PERIOD, _points())


def _points() -> NDArray[np.float64]:
    """(N, 3) where the rays of a spinning sensor with 16 beams meet the room."""
    turn, up = np.meshgrid(np.radians(np.arange(0, 360, 0.8)), np.radians(np.arange(-15, 16, 2)), indexing="ij")
    rays = np.stack([np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn), np.sin(up)], axis=-1).reshape(-1, 3)
    return rays * (_ROOM / np.maximum(np.abs(rays), 1e-9)).min(axis=1, keepdims=True)
