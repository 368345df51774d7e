"""An IMU beside the LiDAR: its newest samples, how the sensor turned by its gyroscope, and where up is."""

from sgslam.inertial.buffer import ImuBuffer
from sgslam.inertial.gyroscope import Gyroscope
from sgslam.inertial.preintegration import NO_TURNS, Turns
from sgslam.inertial.vertical import measured_up

__all__ = ["NO_TURNS", "Gyroscope", "ImuBuffer", "Turns", "measured_up"]
