"""The settings of an IMU beside the LiDAR."""

from pydantic import Field

from sgslam.config.base import Settings


class ImuSettings(Settings):
    """How an IMU sits on the LiDAR, and how it errs; only used where its samples are given."""

    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """degrees, roll, pitch and yaw of the IMU in the LiDAR's axes, turned about x, then y, then z"""
    translation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """m, place of the IMU in the LiDAR's axes; a few centimetres do no harm if they are left out"""
    gyro_noise: float = Field(5e-3, gt=0)
    """rad/s a root of hertz, noise density of the turns between knots; far above a chip's, for the error of its scale
    and of `rotation`: a hundredth of a quick turn"""
    gyro_bias: float = Field(0.02, gt=0)
    """rad/s, standard deviation of the gyroscope's bias at the beginning; data sheets say 0.01 to 0.02"""
    gyro_walk: float = Field(1e-4, gt=0)
    """rad/s a root of a second, random walk of the bias; a chip that warms up: five times that at rest"""
    attitude_error: float = Field(3e-3, gt=0)
    """rad, standard deviation of an attitude by registration, by which the bias is measured"""
    accel_error: float = Field(0.5, gt=0)
    """m/s2, standard deviation of the mean acceleration between knots, biases apart: by a tilt of 1 degree it errs by
    0.17, by a `translation` that is off by 5 cm in a quick hand by 0.5"""
    accel_bias: float = Field(0.2, gt=0)
    """m/s2, standard deviation of the accelerometer's bias at the beginning; data sheets say 0.1 to 0.4"""
    accel_walk: float = Field(1e-3, gt=0)
    """m/s2 a root of a second, random walk of the bias; a chip that warms up: three times that at rest"""
    velocity_error: float = Field(0.05, gt=0)
    """m/s, standard deviation of the velocity between two knots by registration, by which the bias is measured"""
    up_error: float = Field(0.1, gt=0)
    """rad, angle from up as the accelerometer shows it within which the surfaces tell it more exactly"""
