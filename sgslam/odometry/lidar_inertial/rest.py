"""The rest at which a LiDAR-inertial library begins.

It takes the turn and the specific force of the beginning for the gyroscope's bias and for gravity. A hand is never at
rest, so it is given a rest before the first scan instead.
"""

import numpy as np
from numpy.typing import NDArray

from data.imu import ImuSamples
from data.imu.samples import GRAVITY
from sgslam.inertial import ImuBuffer
from sgslam.odometry.lidar_inertial.library import InertialScan

Floats = NDArray[np.float64]
_LASTS_NS, _SAMPLES = 100_000_000, 20
_LARGEST_BIAS = 0.03  # rad/s, more than data sheets say; a faster turn is the carrier's


def rest_before(imu: ImuBuffer, scan: InertialScan, up_in_sensor: Floats | None) -> Floats | None:
    """(6,) rate of turn, rad/s, and specific force, m/s2, of the sensor at rest as at a scan; `up_in_sensor` (3,) where
    it is known, else as the accelerometer shows it. None where samples are missing."""
    samples = imu.around(scan.stamp_ns, scan.end_ns)
    if samples is None:
        return None
    turn, force = samples.gyro.mean(axis=0), samples.accel.mean(axis=0)
    if not np.linalg.norm(turn) < _LARGEST_BIAS:
        turn = np.zeros(3)
    up = force if up_in_sensor is None else up_in_sensor
    return np.concatenate([turn, GRAVITY * up / max(float(np.linalg.norm(up)), 1e-9)])


def samples_at_rest(rest: Floats, until_ns: int) -> ImuSamples:
    """Samples of a `rest` (6,) for a tenth of a second, the last of them just before a stamp."""
    stamps_ns = until_ns - _LASTS_NS // _SAMPLES * np.arange(_SAMPLES, 0, -1)
    rows = np.tile(rest, (_SAMPLES, 1))
    return ImuSamples(stamps_ns.astype(np.int64), rows[:, :3], rows[:, 3:])
