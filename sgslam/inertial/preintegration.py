"""What an IMU measures between knots; preintegrated turns (Forster et al., T-RO 2017, equations 35 and A.20)."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled

Floats = NDArray[np.float64]


class Turns(NamedTuple):
    """How the sensor turned from each knot to the next: `rotations` (K-1, 3, 3), from its later axes to its earlier
    ones, and the `information` (K-1,) about each angle, 1/rad2; zero where nothing was measured."""

    rotations: Floats
    information: Floats


NO_TURNS = Turns(np.empty((0, 3, 3)), np.empty(0))  # without a gyroscope


class Changes(NamedTuple):
    """How much the mean velocity after a knot is more than that before: `values` (K, 3), m/s, of K knots, and the
    `information` (K,) about each axis, s2/m2; zero where nothing was measured."""

    values: Floats
    information: Floats


def no_changes(count: int) -> Changes:
    """At so many knots nothing was measured."""
    return Changes(np.zeros((count, 3)), np.zeros(count))


@compiled
def rotation_of(x: float, y: float, z: float) -> Floats:
    """(3, 3) the rotation of a rotation vector, by Rodrigues' formula."""
    angle = math.sqrt(x * x + y * y + z * z)
    a, b = 1.0, 0.5  # of small angles
    if angle > 1e-6:
        a, b = math.sin(angle) / angle, (1 - math.cos(angle)) / (angle * angle)
    R = np.empty((3, 3))
    R[0, 0], R[0, 1], R[0, 2] = 1 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y
    R[1, 0], R[1, 1], R[1, 2] = b * x * y + a * z, 1 - b * (x * x + z * z), b * y * z - a * x
    R[2, 0], R[2, 1], R[2, 2] = b * x * z - a * y, b * y * z + a * x, 1 - b * (x * x + y * y)
    return R


@compiled
def preintegrated(seconds: Floats, gyro: Floats, bias: Floats, begin: float, end: float) -> tuple[Floats, Floats]:
    """(3, 3) the rotation from the axes at `end` to those at `begin` (s), and how its rotation vector, in the axes at
    `end`, changes with the bias (3, 3).

    The rates of turn (N, 3), less the `bias` (3,), are interpolated between their times (N,).
    """
    R, J, at, i = np.eye(3), np.zeros((3, 3)), begin, 0
    while at < end:
        while i < len(seconds) and seconds[i] <= at:
            i += 1
        until = min(end, seconds[i]) if i < len(seconds) else end
        before, after = max(i - 1, 0), min(i, len(seconds) - 1)
        share = 0.0
        if after > before:
            share = ((at + until) / 2 - seconds[before]) / (seconds[after] - seconds[before])
        lasted = until - at
        w = (gyro[before] + share * (gyro[after] - gyro[before]) - bias) * lasted
        step = rotation_of(w[0], w[1], w[2])
        R = R @ step
        J = step.T @ J
        for axis in range(3):  # the right Jacobian of so small a step is the identity
            J[axis, axis] -= lasted
        at = until
    return R, J
