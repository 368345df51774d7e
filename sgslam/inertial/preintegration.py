"""What an IMU measures between knots; preintegrated turns (Forster et al., T-RO 2017, equations 35 and A.20)."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from sgslam.geometry.compiled import rotated_by, turn_between
from sgslam.types import UnsteadyTurn

Floats = NDArray[np.float64]
_STEP = 0.005  # s, of the integration; that of an IMU with 200 samples a second


class Steps(NamedTuple):
    """How the sensor moved from each knot to the next by something else than its points: `poses` (K-1, 4, 4), from its
    later axes to its earlier ones, and the `information` (K-1, 2) about each angle, 1/rad2, and each coordinate, 1/m2;
    zero where nothing was measured: a gyroscope tells the turns alone."""

    poses: Floats
    information: Floats


NO_STEPS = Steps(np.empty((0, 4, 4)), np.empty((0, 2)))


class Changes(NamedTuple):
    """How much the mean velocity after a knot is more than that before: `values` (K, 3), m/s, of K knots, and the
    `information` (K,) about each axis, s2/m2; zero where nothing was measured."""

    values: Floats
    information: Floats


def no_changes(count: int) -> Changes:
    """At so many knots nothing was measured."""
    return Changes(np.zeros((count, 3)), np.zeros(count))


def steadied(turn: UnsteadyTurn, vectors: NDArray[np.floating[Any]], seconds: Floats) -> Floats:
    """Points or normals (N, 3), measured at `seconds` (N,), as a sensor that turns steadily measures them."""
    return np.asarray(_steadied(np.asarray(vectors, np.float64), seconds, turn.seconds, turn.vectors))


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


@compiled
def _steadied(measured: Floats, seconds: Floats, times: Floats, vectors: Floats) -> Floats:
    turns, found = np.empty((len(measured), 3)), np.empty((len(measured), 3))
    for i in range(3):
        turns[:, i] = np.interp(seconds, times, vectors[:, i])
    for p in range(len(measured)):
        found[p, 0], found[p, 1], found[p, 2] = rotated_by(
            turns[p, 0], turns[p, 1], turns[p, 2], measured[p, 0], measured[p, 1], measured[p, 2]
        )
    return found


@compiled
def unsteady(seconds: Floats, gyro: Floats, bias: Floats, knots: Floats) -> tuple[Floats, Floats]:
    """Times (S,) and rotation vectors (S, 3) of an `UnsteadyTurn` between `knots` (K,), K >= 2, by rates of turn (N, 3)
    at times (N,), less the `bias` (3,)."""
    counts = np.empty(len(knots) - 1, np.int64)
    for k in range(len(counts)):
        counts[k] = math.ceil((knots[k + 1] - knots[k]) / _STEP)
    times, vectors, first = np.empty(counts.sum() + 1), np.zeros((counts.sum() + 1, 3)), 0
    turned = np.empty((counts.max() + 1, 3, 3))
    turned[0], times[0] = np.eye(3), knots[0]
    for k in range(len(counts)):
        count, step = counts[k], (knots[k + 1] - knots[k]) / counts[k]
        for n in range(count):
            begin = knots[k] + n * step
            turned[n + 1] = turned[n] @ preintegrated(seconds, gyro, bias, begin, begin + step)[0]
            times[first + n + 1] = begin + step
        share = turn_between(turned[0], turned[count]) / count
        for n in range(1, count):
            back = rotation_of(-n * share[0], -n * share[1], -n * share[2])
            vectors[first + n] = turn_between(turned[0], back @ turned[n])
        first += count
    return times, vectors
