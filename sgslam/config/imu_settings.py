"""The settings of an IMU beside the LiDAR."""

from pydantic import Field

from sgslam.config.base import Settings


class ImuSettings(Settings):
    """Pose of an IMU on the LiDAR, and its errors; only used if IMU samples are given."""

    rotation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """degrees, roll, pitch and yaw of the IMU in the LiDAR's axes, turned about x, then y, then z"""
    translation: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """m, position of the IMU in the LiDAR's axes; an error of a few centimetres does no harm"""
    gyro_noise: float = Field(5e-3, gt=0)
    """rad/s/sqrt(Hz), noise density of the gyroscope; far above a chip's, to cover errors of its scale and of
    `rotation`: a hundredth of a quick turn"""
    gyro_bias: float = Field(0.02, gt=0)
    """rad/s, standard deviation of the gyroscope's bias at the beginning; data sheets say 0.01 to 0.02"""
    accel_error: float = Field(0.5, gt=0)
    """m/s2, standard deviation of the mean acceleration between two knots, bias excluded: a tilt of 1 degree adds 0.17,
    a `translation` that is off by 5 cm adds 0.5 in a quick hand"""
    accel_bias: float = Field(0.2, gt=0)
    """m/s2, standard deviation of the accelerometer's bias at the beginning; data sheets say 0.1 to 0.4"""
