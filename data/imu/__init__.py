"""Samples of inertial measurement units, and the files that hold them."""

from data.imu.files import read_imu, write_imu
from data.imu.samples import ImuSamples, checked_imu

__all__ = ["ImuSamples", "checked_imu", "read_imu", "write_imu"]
