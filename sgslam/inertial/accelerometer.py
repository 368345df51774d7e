"""How the sensor's velocity changed by its accelerometer, and the accelerometer's bias."""

import math

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from data.imu import ImuSamples
from data.imu.samples import GRAVITY, unit_of_forces
from sgslam.config import ImuSettings
from sgslam.inertial.preintegration import Changes, no_changes, preintegrated
from sgslam.serialization import Stateful

Floats = NDArray[np.float64]
_STEP = 0.005  # s, of the integration; that of an IMU with 200 samples a second
_BETWEEN = 1.0  # s from one measurement of the bias to the next: registration's error is then small against the change


class Accelerometer(Stateful):
    """Changes of the mean velocity from each piece between knots to the next one.

    The bias is a random walk, measured about every second by the velocities that registration finds: a Kalman filter.
    """

    _STATE = ("bias", "_covariance", "_seen", "_changed", "_by_bias")

    def __init__(self, settings: ImuSettings) -> None:
        self._settings = settings
        self.bias = np.zeros(3)  # m/s2
        self._covariance = np.eye(3) * settings.accel_bias**2
        self._seen: tuple[float, Floats] | None = None  # seconds and velocity of the last measurement
        self._changed, self._by_bias = np.zeros(3), np.zeros((3, 3))  # since then: by the samples, and by a bias of 1

    def changes(
        self, seconds: Floats, samples: ImuSamples, gyro_bias: Floats, knots: Floats, R_knots: Floats, up: Floats
    ) -> Changes:
        """The changes at the inner ones of the `knots` (K,) (s), with the attitudes (K, 3, 3) there; samples at
        `seconds` (N,). `up` (3,) is where gravity is not. None of it if the forces are far from gravity."""
        unit = unit_of_forces(samples.accel)
        if unit is None or len(seconds) < 2:
            return no_changes(len(knots) - 2)
        accel = samples.accel * unit - self.bias
        found = velocity_changes(seconds, samples.gyro, gyro_bias, accel, knots, R_knots)
        lasted = (knots[2:] - knots[:-2]) / 2
        return Changes(found - GRAVITY * up * lasted[:, None], 1 / (self._settings.accel_error * lasted) ** 2)

    def follow(self, second: float, velocity: Floats, changed: Floats, by_bias: Floats) -> None:
        """Measures the bias by a velocity (3,) that registration finds: since the one before it was to have `changed`
        (3,), and by `by_bias` (3, 3) times a bias less."""
        self._changed, self._by_bias = self._changed + changed, self._by_bias + by_bias
        if self._seen is not None and second - self._seen[0] < _BETWEEN:
            return
        if self._seen is not None:
            self._correct(velocity - self._seen[1] - self._changed, second - self._seen[0])
        self._seen = second, velocity.copy()
        self._changed, self._by_bias = np.zeros(3), np.zeros((3, 3))

    def _correct(self, off: Floats, lasted: float) -> None:
        """A Kalman filter's step: the velocity changed by `off` (3,) more than was measured."""
        settings, J = self._settings, -self._by_bias
        P = self._covariance + np.eye(3) * settings.accel_walk**2 * lasted
        gain = P @ J.T @ np.linalg.inv(J @ P @ J.T + np.eye(3) * 2 * settings.velocity_error**2)
        self.bias = self.bias + gain @ off
        P = P - gain @ J @ P
        self._covariance = (P + P.T) / 2

    def lose(self) -> None:
        """To be called where velocities are not known any more."""
        self._seen = None
        self._changed, self._by_bias = np.zeros(3), np.zeros((3, 3))


@compiled
def velocity_changes(
    seconds: Floats, gyro: Floats, gyro_bias: Floats, accel: Floats, knots: Floats, R_knots: Floats
) -> Floats:
    """(K-2, 3) how much the mean velocity between two of the `knots` (K,) is more than that between the two before, by
    the specific forces alone, in the frame of the attitudes (K, 3, 3).

    A force between the knots counts the more, the nearer it is to the inner one. Samples (N, 3) are at times (N,).
    """
    rising, falling = np.zeros((len(knots), 3)), np.zeros((len(knots), 3))  # of the piece after a knot
    for k in range(len(knots) - 1):
        lasted = knots[k + 1] - knots[k]
        count = math.ceil(lasted / _STEP)
        R = R_knots[k].copy()
        for n in range(count):
            begin = knots[k] + lasted * n / count
            middle, end = begin + lasted / (2 * count), begin + lasted / count
            R = R @ preintegrated(seconds, gyro, gyro_bias, begin, middle)[0]
            push = R @ _at(seconds, accel, middle) * (lasted / count)
            R = R @ preintegrated(seconds, gyro, gyro_bias, middle, end)[0]
            share = (n + 0.5) / count
            rising[k] += share * push
            falling[k] += (1 - share) * push
    return rising[:-2] + falling[1:-1]


@compiled
def _at(seconds: Floats, values: Floats, second: float) -> Floats:
    """(3,) the values (N, 3) at times (N,), N >= 2, interpolated; beyond both ends those at the end."""
    i = min(max(int(np.searchsorted(seconds, second)), 1), len(seconds) - 1)
    share = min(max((second - seconds[i - 1]) / (seconds[i] - seconds[i - 1]), 0.0), 1.0)
    return values[i - 1] + share * (values[i] - values[i - 1])
