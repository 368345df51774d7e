"""What an inertial measurement unit beside a simulated sensor measures while it is carried."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from data.common.errors import UserError
from data.imu import GRAVITY, ImuSamples

Array = NDArray[np.float64]
RATE = 200  # samples a second
_CHANCE = 53  # makes the noise another one than that of the scans of the same seed


@dataclass(frozen=True)
class ImuModel:
    """Errors of gyroscope (rad/s) and accelerometer (m/s2), each axis by itself.

    `noise` are the densities of the white noise, a root of hertz; `walk` those of the biases' random walks, a root of a
    second; `bias` the standard deviations of the constant biases.
    """

    gyro_noise: float = 0.0
    gyro_walk: float = 0.0
    gyro_bias: float = 0.0
    accel_noise: float = 0.0
    accel_walk: float = 0.0
    accel_bias: float = 0.0


_MDPS, _UG, _DEG_H = np.radians(1e-3), 1e-6 * GRAVITY, np.radians(1.0) / 3600
IMUS = {
    # ICM-40609-D, the chip in the Livox Mid-360: 4.5 mdps and 100 ug a root of hertz, offsets of 1 dps and 25 mg at
    # most (its data sheet; here two standard deviations). Random walks: of a chip of its class, in the calibration that
    # the EuRoC data comes with (gyroscope 1.9e-5; accelerometer 3e-3, which temperature caused, so a tenth of it).
    "mid360": ImuModel(4.5 * _MDPS, 1.9e-5, 500 * _MDPS, 100 * _UG, 3e-4, 12_500 * _UG),
    # STIM300 (its data sheet): 0.15 deg and 0.07 m/s a root of an hour, repeated within 4 deg/h and 0.75 mg; stable to
    # 0.5 deg/h and 0.05 mg, here taken for walks of a hundred seconds.
    "tactical": ImuModel(np.radians(0.15) / 60, 0.05 * _DEG_H, 4 * _DEG_H, 0.07 / 60, 5 * _UG, 750 * _UG),
}


def imu_named(name: str) -> ImuModel:
    """The IMU of this class; raises UserError for an unknown one."""
    if name not in IMUS:
        raise UserError(f"IMU '{name}' is not known; give one of {', '.join(IMUS)}")
    return IMUS[name]


def measured(poses: Callable[[Array], Array], seconds: float, model: ImuModel, seed: int) -> ImuSamples:
    """What an IMU measures for so many seconds, RATE a second, in the axes of the poses (N, 4, 4) at times (N,).

    The poses are in a frame with z up, and smooth. A sample is the mean over the time around it until halfway to its
    neighbours, as that of a unit that filters.
    """
    at, half = np.arange(int(seconds * RATE) + 1) / RATE, 0.5 / RATE
    before, middle, after = poses(at - half), poses(at), poses(at + half)
    turns = before[:, :3, :3].transpose(0, 2, 1) @ after[:, :3, :3]
    gyro = Rotation.from_matrix(turns).as_rotvec() * RATE
    acceleration = (before[:, :3, 3] - 2 * middle[:, :3, 3] + after[:, :3, 3]) / half**2
    accel = np.einsum("nji,nj->ni", middle[:, :3, :3], acceleration + np.array([0.0, 0.0, GRAVITY]))
    rng = np.random.default_rng([seed, _CHANCE])
    gyro += _errors(rng, len(at), model.gyro_noise, model.gyro_walk, model.gyro_bias)
    accel += _errors(rng, len(at), model.accel_noise, model.accel_walk, model.accel_bias)
    return ImuSamples(np.rint(at * 1e9).astype(np.int64), gyro, accel)


def _errors(rng: np.random.Generator, count: int, noise: float, walk: float, bias: float) -> Array:
    """(N, 3) white noise, a bias that wanders, and a constant one."""
    white = rng.normal(size=(count, 3)) * noise * np.sqrt(RATE)
    wandering = np.cumsum(rng.normal(size=(count, 3)), axis=0) * walk / np.sqrt(RATE)
    return np.asarray(white + wandering + rng.normal(size=3) * bias)
