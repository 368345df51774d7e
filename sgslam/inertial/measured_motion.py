"""What an IMU tells of the motion between knots: turns, and changes of the velocity."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sgslam.inertial.accelerometer import Accelerometer
from sgslam.inertial.buffer import ImuBuffer
from sgslam.inertial.gyroscope import Gyroscope
from sgslam.inertial.preintegration import Changes, Turns, no_changes
from sgslam.inertial.unsteady import UnsteadyTurn

Floats = NDArray[np.float64]


class MeasuredMotion:
    """Turns and changes of velocity at times in seconds after `begin`; both biases are estimated."""

    def __init__(self, imu: ImuBuffer) -> None:
        self._imu = imu
        self._gyro, self._accel = Gyroscope(imu), Accelerometer(imu.settings)

    def begin(self, first_ns: int) -> None:
        """Sets the stamp at which seconds are 0."""
        self._gyro.begin(first_ns)

    def backwards(self) -> "MeasuredMotion":
        """The same, as time runs backwards; the biases are what they are now."""
        other = MeasuredMotion(self._imu)
        other._gyro = self._gyro.backwards()
        other._accel.restore(self._accel.state())
        other._accel.lose()
        return other

    def turns(self, seconds: Floats) -> Turns:
        """The turns between knots at times (K,) that increase."""
        return self._gyro.between(seconds)

    def turned(self, seconds: Floats, knots: Floats) -> Floats:
        """See `Gyroscope.turned`."""
        return self._gyro.turned(seconds, knots)

    def unsteady(self, seconds: Floats) -> UnsteadyTurn | None:
        """How unsteadily the sensor turns between knots at times (K,); None where samples are missing."""
        return self._gyro.unsteady(seconds)

    def changes(self, seconds: Floats, knots: Floats, before: float, up: Floats) -> Changes:
        """The changes of the mean velocity at all but the last of the knots (K, 4, 4) at times (K,): at the first one,
        from the velocity in the piece of `before` seconds that ends there, if that is known, else 0.

        `up` (3,) is the direction of gravity, zero while it is unknown: then nothing is known.
        """
        count = len(seconds) - 1
        if not up.any() or count < 1:
            return no_changes(count)
        R = np.ascontiguousarray(knots[:, :3, :3])
        if before:
            seconds = np.concatenate([[seconds[0] - before], seconds])
            back = self._gyro.turn(float(seconds[0]), float(seconds[1]))
            R = np.concatenate([[R[0] @ back.T if back is not None else R[0]], R])
        found = self._at_inner(seconds, R, up)
        if before:
            return found
        none = no_changes(1)
        return Changes(np.vstack([none.values, found.values]), np.append(none.information, found.information))

    def _at_inner(self, seconds: Floats, R: Floats, up: Floats) -> Changes:
        """The changes at the inner ones of the knots (K,); an acceleration is the same if time runs backwards."""
        forward, step = self._gyro.forward(seconds), -1 if self._gyro.runs_backwards else 1
        samples = self._gyro.samples(float(forward[0]), float(forward[-1]))
        if samples is None or self._imu.unit is None:
            return no_changes(len(seconds) - 2)
        accel = samples[1].accel * self._imu.unit
        found = self._accel.changes(samples[0], samples[1].gyro - self._gyro.bias, accel, forward, R[::step].copy(), up)
        return Changes(found.values[::step].copy(), found.information[::step].copy())

    def follow(self, seconds: Floats, knots: Floats, changes: Changes) -> None:
        """Measures the biases by the knots (K, 4, 4) that registration finds, at times (K,): the first one is the last
        one of the call before. `changes` are those at all but the last of them."""
        self._gyro.follow(float(seconds[-1]), knots[-1, :3, :3])
        if len(seconds) < 2 or not (changes.information > 0).all():
            self._accel.lose()
            return
        lasted = np.diff(seconds)
        halves = (lasted + np.append(lasted[0], lasted[:-1])) / 2
        by_bias = np.einsum("k,kij->ij", halves, knots[:-1, :3, :3])
        velocity = (knots[-1, :3, 3] - knots[-2, :3, 3]) / lasted[-1]
        self._accel.follow(float(seconds[-1]), velocity, changes.values.sum(axis=0), by_bias)

    def lose(self) -> None:
        """To be called where poses are not known any more."""
        self._gyro.lose()
        self._accel.lose()

    def state(self) -> dict[str, Any]:
        """What `restore` takes."""
        return {"gyro": self._gyro.state(), "accel": self._accel.state()}

    def restore(self, state: dict[str, Any]) -> None:
        """Restores what `state` returned."""
        self._gyro.restore(state["gyro"])
        self._accel.restore(state["accel"])
