"""How the sensor turned by its gyroscope, and the gyroscope's bias."""

from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from data.imu import ImuSamples
from sgslam.inertial.bias import Bias
from sgslam.inertial.buffer import ImuBuffer
from sgslam.inertial.preintegration import NO_TURNS, Turns, preintegrated
from sgslam.inertial.unsteady import UnsteadyTurn, unsteady
from sgslam.serialization import Stateful

Floats = NDArray[np.float64]
_BETWEEN = 1.0  # s from one measurement of the bias to the next: registration's error is then small against the turn


class Gyroscope(Stateful):
    """Turns between times, in seconds after `begin`.

    The bias is measured about every second by the turn that registration finds.
    """

    _STATE = ("_first_ns", "_seen")

    def __init__(self, imu: ImuBuffer) -> None:
        self._imu, self._direction = imu, 1
        self._first_ns = 0
        settings = imu.settings
        self._bias = Bias(settings.gyro_bias, settings.gyro_walk, settings.attitude_error)
        self._seen: tuple[float, Floats] | None = None  # seconds and attitude of the last measurement

    @property
    def bias(self) -> Floats:
        """(3,) rad/s, as far as it is known."""
        return self._bias.value

    def begin(self, first_ns: int) -> None:
        """Sets the stamp at which seconds are 0."""
        self._first_ns = first_ns

    def backwards(self) -> "Gyroscope":
        """The same gyroscope, as time runs backwards; its bias is what it is now."""
        other = Gyroscope(self._imu)
        other.restore(self.state())
        other._direction, other._seen = -self._direction, None
        return other

    @property
    def runs_backwards(self) -> bool:
        """Whether time runs backwards."""
        return self._direction < 0

    def forward(self, seconds: Floats) -> Floats:
        """Times (K,) in the order in which they passed."""
        return -seconds[::-1] if self.runs_backwards else seconds

    def samples(self, begin: float, end: float) -> tuple[Floats, ImuSamples] | None:
        """The samples between two times, as they passed, with their seconds (N,); None where some are missing."""
        found = self._imu.around(*(self._first_ns + round(second * 1e9) for second in (begin, end)))
        return None if found is None else ((found.stamps_ns - self._first_ns) / 1e9, found)

    def unsteady(self, knots: Floats) -> UnsteadyTurn | None:
        """How unsteadily the sensor turns between knots at times (K,); None where samples are missing."""
        samples = self.samples(float(knots[0]), float(knots[-1])) if len(knots) > 1 else None
        return None if samples is None else UnsteadyTurn(*unsteady(samples[0], samples[1].gyro, self.bias, knots))

    def turn(self, begin: float, end: float) -> Floats | None:
        """(3, 3) the turn between two times; None where samples are missing."""
        found = self._preintegrated(begin, end)
        return None if found is None else found[0]

    def between(self, seconds: Floats) -> Turns:
        """The turns between knots at times (K,) that increase."""
        settings, lasted = self._imu.settings, np.diff(seconds)
        found = [self._preintegrated(a, b) for a, b in pairwise(seconds)]
        known = np.array([own is not None for own in found])
        if not known.any():
            return NO_TURNS
        rotations = np.stack([np.eye(3) if own is None else own[0] for own in found])
        bias_variance = float(np.linalg.eigvalsh(self._bias.covariance)[-1])
        return Turns(rotations, known / (settings.gyro_noise**2 * lasted + bias_variance * lasted**2))

    def turned(self, seconds: Floats, knots: Floats) -> Floats:
        """Knots (K, 4, 4) at times (K,), with the attitudes that follow from the first one, as far as is measured."""
        result = knots.copy()
        for k in range(1, len(knots)):
            found = self._preintegrated(seconds[k - 1], seconds[k])
            if found is None:
                break
            result[k, :3, :3] = result[k - 1, :3, :3] @ found[0]
        return result

    def follow(self, second: float, R_odom_sensor: Floats) -> None:
        """Measures the bias by an attitude (3, 3) that registration finds."""
        if self._seen is None:
            self._seen = second, R_odom_sensor.copy()
            return
        before, R_before = self._seen
        if second - before < _BETWEEN:
            return
        self._seen = second, R_odom_sensor.copy()
        found = self._preintegrated(before, second)
        if found is not None:
            R, J = found
            off = Rotation.from_matrix(R.T @ R_before.T @ R_odom_sensor).as_rotvec()
            self._bias.correct(off, J, second - before)

    def lose(self) -> None:
        """To be called where attitudes are not known any more."""
        self._seen = None

    def _preintegrated(self, begin: float, end: float) -> tuple[Floats, Floats] | None:
        """See `preintegrated`; None where samples are missing."""
        low, high = sorted((self._direction * begin, self._direction * end))
        samples = self.samples(low, high)
        if samples is None:
            return None
        R, J = preintegrated(samples[0], samples[1].gyro, self.bias, low, high)
        return (R, J) if self._direction > 0 else (R.T.copy(), -R @ J)

    def state(self) -> dict[str, Any]:
        """See `Stateful`."""
        return {**super().state(), "bias": self._bias.state()}

    def restore(self, state: dict[str, Any]) -> None:
        """See `Stateful`."""
        super().restore(state)
        self._bias.restore(state["bias"])
