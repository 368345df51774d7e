"""How the sensor's velocity changed by its accelerometer, and the accelerometer's bias."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from data.imu.samples import GRAVITY
from sgslam.config import ImuSettings
from sgslam.inertial.bias import Bias
from sgslam.inertial.preintegration import Changes, no_changes, preintegrated
from sgslam.serialization import Stateful

Floats = NDArray[np.float64]
_STEP = 0.005  # s, of the integration; that of an IMU with 200 samples a second
_BETWEEN = 1.0  # s from one measurement of the bias to the next: registration's error is then small against the change


class Accelerometer(Stateful):
    """Changes of the mean velocity from each piece between knots to the next one.

    The bias is measured about every second by the velocities that registration finds.
    """

    _STATE = ("_seen", "_changed", "_by_bias")

    def __init__(self, settings: ImuSettings) -> None:
        self._settings = settings
        self._bias = Bias(settings.accel_bias, settings.accel_walk, settings.velocity_error)
        self._seen: tuple[float, Floats] | None = None  # seconds and velocity of the last measurement
        self._changed, self._by_bias = np.zeros(3), np.zeros((3, 3))  # since then: by the samples, and by a bias of 1

    @property
    def bias(self) -> Floats:
        """(3,) m/s2, as far as it is known."""
        return self._bias.value

    def changes(
        self, seconds: Floats, rates: Floats, accel: Floats, knots: Floats, R_knots: Floats, up: Floats
    ) -> Changes:
        """The changes at the inner ones of the `knots` (K,) (s), with the attitudes (K, 3, 3) there; rates of turn
        (N, 3), without bias, and specific forces (N, 3), m/s2, at `seconds` (N,). `up` (3,) is where gravity is not.
        """
        if len(seconds) < 2:
            return no_changes(len(knots) - 2)
        found = velocity_changes(seconds, rates, accel - self.bias, knots, R_knots)
        lasted = (knots[2:] - knots[:-2]) / 2
        return Changes(found - GRAVITY * up * lasted[:, None], 1 / (self._settings.accel_error * lasted) ** 2)

    def follow(self, second: float, velocity: Floats, changed: Floats, by_bias: Floats) -> None:
        """Measures the bias by a velocity (3,) that registration finds: since the one before it was to have `changed`
        (3,), and by `by_bias` (3, 3) times a bias less."""
        self._changed, self._by_bias = self._changed + changed, self._by_bias + by_bias
        if self._seen is not None and second - self._seen[0] < _BETWEEN:
            return
        if self._seen is not None:
            off = velocity - self._seen[1] - self._changed
            self._bias.correct(off, -self._by_bias, second - self._seen[0])
        self._seen = second, velocity.copy()
        self._changed, self._by_bias = np.zeros(3), np.zeros((3, 3))

    def lose(self) -> None:
        """To be called where velocities are not known any more."""
        self._seen = None
        self._changed, self._by_bias = np.zeros(3), np.zeros((3, 3))

    def state(self) -> dict[str, Any]:
        """See `Stateful`."""
        return {**super().state(), "bias": self._bias.state()}

    def restore(self, state: dict[str, Any]) -> None:
        """See `Stateful`."""
        super().restore(state)
        self._bias.restore(state["bias"])


@compiled
def velocity_changes(seconds: Floats, rates: Floats, accel: Floats, knots: Floats, R_knots: Floats) -> Floats:
    """(K-2, 3) how much the mean velocity between two of the `knots` (K,) is more than that between the two before, by
    the specific forces alone, in the frame of the attitudes (K, 3, 3).

    A force between the knots counts the more, the nearer it is to the inner one. Samples (N, 3) are at times (N,).
    """
    unbiased = np.zeros(3)
    rising, falling = np.zeros((len(knots), 3)), np.zeros((len(knots), 3))  # of the piece after a knot
    for k in range(len(knots) - 1):
        lasted = knots[k + 1] - knots[k]
        count = math.ceil(lasted / _STEP)
        R = R_knots[k].copy()
        for n in range(count):
            begin = knots[k] + lasted * n / count
            middle, end = begin + lasted / (2 * count), begin + lasted / count
            R = R @ preintegrated(seconds, rates, unbiased, begin, middle)[0]
            push = R @ _at(seconds, accel, middle) * (lasted / count)
            R = R @ preintegrated(seconds, rates, unbiased, middle, end)[0]
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
