"""An IMU beside the LiDAR: its newest samples, how the sensor moved by them, and where up is."""

from sgslam.inertial.buffer import ImuBuffer
from sgslam.inertial.measured_motion import MeasuredMotion, measured_up
from sgslam.inertial.preintegration import NO_STEPS, Changes, Steps, no_changes, steadied

__all__ = [
    "NO_STEPS",
    "Changes",
    "ImuBuffer",
    "MeasuredMotion",
    "Steps",
    "measured_up",
    "no_changes",
    "steadied",
]
