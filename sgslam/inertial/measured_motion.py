"""What an IMU tells of the motion between knots: turns, changes of the velocity, up; both biases are estimated."""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from data.imu import GRAVITY, ImuSamples, unit_of_forces
from sgslam.inertial.buffer import ImuBuffer
from sgslam.inertial.preintegration import (
    NO_STEPS,
    Changes,
    Steps,
    no_changes,
    preintegrated,
    unsteady,
    velocity_changes,
)
from sgslam.types import UnsteadyTurn

Floats = NDArray[np.float64]
_SHORTEST_NS = 900_000_000  # over a shorter time the carrier's steps outweigh gravity
_PLACE = 0.03  # m, standard deviation of places by registration
_WRONG = 0.2  # share by which the found gravity may differ from the true one; more, and the places are wrong
_BETWEEN = 1.0  # s from one measurement of a bias to the next: registration's error is then small against the motion
_WALK = 0.005  # of a bias, as a share of its first standard deviation, in a root of a second: for a chip that warms up
_ATTITUDE, _VELOCITY = 3e-3, 0.05  # rad and m/s, standard deviations of what registration finds


def measured_up(imu: ImuBuffer, stamps_ns: NDArray[np.int64], poses: Floats, speed: float) -> Floats | None:
    """(3,) the unit vector upwards in the frame of the poses (N, 4, 4) of the sensor at stamps (N,). The standard
    deviation of the first velocity is `speed` (m/s).

    Twice integrated, the specific force is the way from the first place, less that by the first velocity, and by
    gravity: both are found by least squares. None where samples are missing or far from gravity, in m/s2 as in g, or
    the time is too short.
    """
    if len(stamps_ns) < 2 or stamps_ns[-1] - stamps_ns[0] < _SHORTEST_NS:
        return None
    samples = imu.around(int(stamps_ns[0]), int(stamps_ns[-1]))
    unit = None if samples is None else unit_of_forces(samples.accel)
    if samples is None or unit is None:
        return None
    at, seconds = (samples.stamps_ns - stamps_ns[0]) / 1e9, (stamps_ns - stamps_ns[0]) / 1e9
    attitudes = Slerp(seconds, Rotation.from_matrix(poses[:, :3, :3]))(np.clip(at, 0.0, seconds[-1]))
    forces = attitudes.apply(unit * samples.accel)
    usual = forces.mean(axis=0)
    ways = poses[1:, :3, 3] - poses[0, :3, 3] - _twice_integrated(at, forces, seconds)[1:]
    t = seconds[1:, None]
    rows = np.concatenate([np.hstack([t, -(t**2) / 2]) / _PLACE, [[1 / speed, 0.0]]])
    _, gravity = np.linalg.lstsq(rows, np.concatenate([ways / _PLACE, np.zeros((1, 3))]), rcond=None)[0]
    found = gravity if abs(np.linalg.norm(gravity) / GRAVITY - 1) < _WRONG else usual
    return np.asarray(found / np.linalg.norm(found))


def _twice_integrated(at: Floats, forces: Floats, seconds: Floats) -> Floats:
    """(N, 3) the ways at `seconds` (N,) of a body that begins at rest, with accelerations (M, 3) at times (M,)."""
    steps = np.diff(at, prepend=at[0])[:, None]
    velocities = np.cumsum((forces + np.roll(forces, 1, axis=0)) / 2 * steps, axis=0)
    ways = np.cumsum((velocities + np.roll(velocities, 1, axis=0)) / 2 * steps, axis=0)
    return np.column_stack([np.interp(seconds, at, column) for column in ways.T])


class _Bias:
    """The bias of an inertial sensor, a random walk in three axes: a Kalman filter, by what registration finds.

    At the beginning it is zero with a standard deviation of `first`. `error` is the standard deviation of each of the
    two values by registration that a measurement compares.
    """

    def __init__(self, first: float, error: float) -> None:
        self._walk, self._error = _WALK * first, error
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


class MeasuredMotion:
    """Turns and changes of velocity at times in seconds after `begin`.

    The biases are measured about every second by the attitudes and velocities that registration finds.
    """

    def __init__(self, imu: ImuBuffer) -> None:
        self._imu, self._settings, self._first_ns = imu, imu.settings, 0
        self._gyro_bias = _Bias(self._settings.gyro_bias, _ATTITUDE)
        self._accel_bias = _Bias(self._settings.accel_bias, _VELOCITY)
        self._seen: tuple[float, Floats, Floats] | None = None  # s, attitude, velocity at the last measurement
        # The change of velocity since then by the samples (3,), and by a bias of 1 (3, 3); None where some are missing.
        self._changed: tuple[Floats, Floats] | None = None

    @property
    def biases(self) -> tuple[Floats, Floats]:
        """(3,) rad/s of the gyroscope and (3,) m/s2 of the accelerometer, as far as they are known."""
        return self._gyro_bias.value, self._accel_bias.value

    def begin(self, first_ns: int) -> None:
        """Sets the stamp at which seconds are 0."""
        self._first_ns = first_ns

    def turns(self, seconds: Floats) -> Steps:
        """The turns between knots at times (K,) that increase."""
        found = [self._turn(a, b) for a, b in pairwise(seconds)]
        known = np.array([own is not None for own in found])
        if not known.any():
            return NO_STEPS
        lasted = np.diff(seconds)
        poses = np.tile(np.eye(4), (len(lasted), 1, 1))
        for pose, own in zip(poses, found, strict=True):
            pose[:3, :3] = np.eye(3) if own is None else own[0]
        bias_variance = float(np.linalg.eigvalsh(self._gyro_bias.covariance)[-1])
        information = known / (self._settings.gyro_noise**2 * lasted + bias_variance * lasted**2)
        return Steps(poses, np.column_stack([information, np.zeros(len(lasted))]))

    def turned(self, seconds: Floats, knots: Floats) -> Floats:
        """Knots (K, 4, 4) at times (K,), with the attitudes that follow from the first one, as far as is measured."""
        result = knots.copy()
        for k in range(1, len(knots)):
            found = self._turn(seconds[k - 1], seconds[k])
            if found is None:
                break
            result[k, :3, :3] = result[k - 1, :3, :3] @ found[0]
        return result

    def unsteady(self, seconds: Floats) -> UnsteadyTurn | None:
        """How unsteadily the sensor turns between knots at times (K,); None where samples are missing."""
        samples = self._samples(float(seconds[0]), float(seconds[-1])) if len(seconds) > 1 else None
        if samples is None:
            return None
        return UnsteadyTurn(*unsteady(samples[0], samples[1].gyro, self._gyro_bias.value, seconds))

    def changes(self, seconds: Floats, knots: Floats, before: float, up: Floats) -> Changes:
        """The changes of the mean velocity at all but the last of the knots (K, 4, 4) at times (K,): at the first one,
        from the velocity in the piece of `before` seconds that ends there, if that is known, else 0.

        `up` (3,) is the direction of gravity, zero while it is unknown: then nothing is known.
        """
        count = len(seconds) - 1
        if not up.any() or count < 1 or self._imu.newest_ns is None:
            return no_changes(count)
        R = np.ascontiguousarray(knots[:, :3, :3])
        if not before:
            found, none = self._at_inner(seconds, R, up), no_changes(1)
            values = np.vstack([none.values, found.values])
            return Changes(values, np.append(none.information, found.information))
        seconds = np.concatenate([[seconds[0] - before], seconds])
        back = self._turn(float(seconds[0]), float(seconds[1]))
        R = np.concatenate([[R[0] @ back[0].T if back is not None else R[0]], R])
        return self._at_inner(seconds, R, up)

    def _at_inner(self, seconds: Floats, R: Floats, up: Floats) -> Changes:
        """The changes at the inner ones of the knots (K,)."""
        samples, unit = self._samples(float(seconds[0]), float(seconds[-1])), self._imu.unit
        if samples is None or unit is None or len(samples[0]) < 2:
            return no_changes(len(seconds) - 2)
        (at, measured), (gyro_bias, accel_bias) = samples, self.biases
        rates, forces = measured.gyro - gyro_bias, measured.accel * unit - accel_bias
        values = velocity_changes(at, rates, forces, seconds, R)
        lasted = (seconds[2:] - seconds[:-2]) / 2
        values -= GRAVITY * up * lasted[:, None]
        return Changes(values, 1 / (self._settings.accel_error * lasted) ** 2)

    def follow(self, seconds: Floats, knots: Floats, changes: Changes) -> None:
        """Measures the biases by the knots (K, 4, 4) that registration finds, at times (K,): the first one is the last
        one of the call before. `changes` are those at all but the last of them."""
        if len(seconds) < 2:  # one knot shows no motion
            return
        second, R, lasted = float(seconds[-1]), knots[-1, :3, :3].copy(), np.diff(seconds)
        velocity = (knots[-1, :3, 3] - knots[-2, :3, 3]) / lasted[-1]
        if not (changes.information > 0).all():
            self._changed = None
        elif self._changed is not None:
            halves = (lasted + np.append(lasted[0], lasted[:-1])) / 2
            by_bias = np.einsum("k,kij->ij", halves, knots[:-1, :3, :3])
            self._changed = self._changed[0] + changes.values.sum(axis=0), self._changed[1] + by_bias
        if self._seen is not None and second - self._seen[0] < _BETWEEN:
            return
        if self._seen is not None:
            before, R_before, velocity_before = self._seen
            found = self._turn(before, second)
            if found is not None:
                off = Rotation.from_matrix(found[0].T @ R_before.T @ R).as_rotvec()
                self._gyro_bias.correct(off, found[1], second - before)
            if self._changed is not None:
                off = velocity - velocity_before - self._changed[0]
                self._accel_bias.correct(off, -self._changed[1], second - before)
        self._seen, self._changed = (second, R, velocity), (np.zeros(3), np.zeros((3, 3)))

    def lose(self) -> None:
        """To be called where poses are not known any more."""
        self._seen = self._changed = None

    def _samples(self, begin: float, end: float) -> tuple[Floats, ImuSamples] | None:
        """The samples between two times, as they passed, with their seconds (N,); None where some are missing."""
        if self._imu.newest_ns is None:
            return None
        found = self._imu.around(*(self._first_ns + round(second * 1e9) for second in (begin, end)))
        return None if found is None else ((found.stamps_ns - self._first_ns) / 1e9, found)

    def _turn(self, begin: float, end: float) -> tuple[Floats, Floats] | None:
        """See `preintegrated`; None where samples are missing."""
        samples = self._samples(begin, end)
        if samples is None:
            return None
        R, J = preintegrated(samples[0], samples[1].gyro, self._gyro_bias.value, begin, end)
        return R, J
