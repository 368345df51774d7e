"""The settings of an IMU beside the LiDAR."""

from pydantic import Field

from sgslam.config.base import Settings


class ImuSettings(Settings):
    """How an IMU sits on the LiDAR, and how it errs; only used where its samples are given."""

    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """degrees, roll, pitch and yaw of the IMU in the LiDAR's axes, turned about x, then y, then z"""
    gyro_noise: float = Field(5e-3, gt=0)
    """rad/s a root of hertz, noise density of the turns between knots; far above a chip's, since between knots a hand
    does not turn steadily: 1 to 3 mrad"""
    gyro_bias: float = Field(0.02, gt=0)
    """rad/s, standard deviation of the gyroscope's bias at the beginning; data sheets say 0.01 to 0.02"""
    gyro_walk: float = Field(1e-4, gt=0)
    """rad/s a root of a second, random walk of the bias; a chip that warms up: five times that at rest"""
    attitude_error: float = Field(3e-3, gt=0)
    """rad, standard deviation of an attitude by registration, by which the bias is measured"""
    up_error: float = Field(0.1, gt=0)
    """rad, angle from up as the accelerometer shows it within which the surfaces tell it more exactly"""
