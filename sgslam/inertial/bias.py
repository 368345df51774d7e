"""The bias of an inertial sensor."""

import numpy as np
from numpy.typing import NDArray

from sgslam.serialization import Stateful

Floats = NDArray[np.float64]


class Bias(Stateful):
    """A random walk in three axes, measured now and then by what registration finds: a Kalman filter.

    At the beginning it is zero with a standard deviation of `first`; it walks by `walk` a root of a second. `error` is
    the standard deviation of each of the two values by registration that a measurement compares.
    """

    _STATE = ("value", "covariance")

    def __init__(self, first: float, walk: float, error: float) -> None:
        self._walk, self._error = walk, error
        self.value: Floats = np.zeros(3)
        self.covariance: Floats = np.eye(3) * first**2

    def correct(self, off: Floats, J: Floats, lasted: float) -> None:
        """By `off` (3,) registration found more than was measured in the time (s) that `lasted`; with the bias, that
        changes by J (3, 3)."""
        P = self.covariance + np.eye(3) * self._walk**2 * lasted
        gain = P @ J.T @ np.linalg.inv(J @ P @ J.T + np.eye(3) * 2 * self._error**2)
        self.value = self.value + gain @ off
        P = P - gain @ J @ P
        self.covariance = (P + P.T) / 2
