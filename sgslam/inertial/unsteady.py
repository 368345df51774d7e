"""How unsteadily a sensor turns between two knots, and its points as if it turned steadily."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from sgslam.geometry.rotations import rotated_by, turn_between
from sgslam.inertial.preintegration import preintegrated, rotation_of

Floats = NDArray[np.float64]
_STEP = 0.005  # s, between the times at which attitudes are compared; that of an IMU with 200 samples a second


@dataclass(frozen=True, eq=False)
class UnsteadyTurn:
    """Rotation `vectors` (S, 3) at `seconds` (S,), ascending: the attitude relative to that of a steady turn between
    knots, in the sensor's axes."""

    seconds: Floats
    vectors: Floats

    def later(self, seconds: float) -> "UnsteadyTurn":
        """The same, so many seconds later."""
        return UnsteadyTurn(self.seconds + seconds, self.vectors)

    def steadied(self, vectors: NDArray[np.floating[Any]], seconds: Floats) -> Floats:
        """Points or normals (N, 3), measured at `seconds` (N,), as a sensor that turns steadily measures them."""
        return np.asarray(_steadied(np.asarray(vectors, np.float64), seconds, self.seconds, self.vectors))


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
