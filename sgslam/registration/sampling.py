"""Thins a scan out to points spread evenly in space."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from sgslam.config import TrackingSettings
from sgslam.geometry.normal_equations import eigen
from sgslam.inertial import UnsteadyTurn
from sgslam.registration.points import UNKNOWN

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Ints32 = NDArray[np.int32]
_FIRST_SIDE, _FINEST_SIDE = 0.03, 0.05  # m between the points that are used: in the first scan, and least
_PATCH = 0.25  # m, of the cells whose points show the normal of a scan's surface
_LEAST = 8  # points of such a cell
_FLAT = 4.0  # times the variance across, that along a surface in its narrower direction at least
_NOISE = 0.02  # m, standard deviation of a range: by it alone, the points of one ring spread along their rays
_SHORTEST = 1e-3  # s; a shorter scan is a snapshot


@dataclass(frozen=True, eq=False)
class TimedPoints:
    """Points (N, 6) of a scan that are used, in the sensor frame, measured at `seconds` (N,).

    Their first three columns are places, the others normals of the scan's surfaces there; zero where it shows none.

    `knot_seconds` (K,) divide the scan into pieces of steady motion; one knot for a snapshot. `plane_of` (N,) are the
    surfels of the local map that the points lie on, as far as known.
    """

    points: Floats
    seconds: Floats
    knot_seconds: Floats
    plane_of: Ints32

    def later(self, seconds: float) -> "TimedPoints":
        """The same points, measured so many seconds later."""
        return TimedPoints(self.points, self.seconds + seconds, self.knot_seconds + seconds, self.plane_of)

    def reversed(self) -> "TimedPoints":
        """The same points, as time runs backwards."""
        return TimedPoints(self.points, -self.seconds, -self.knot_seconds[::-1], self.plane_of)

    def steadied(self, turn: UnsteadyTurn) -> "TimedPoints":
        """The same points, of a sensor that turns steadily between the knots."""
        parts = [turn.steadied(own, self.seconds) for own in np.hsplit(self.points, 2)]
        return TimedPoints(np.hstack(parts), self.seconds, self.knot_seconds, self.plane_of)


def thinned(
    points: Floats, point_times: Floats | None, began: float, side: float, settings: TrackingSettings
) -> tuple[TimedPoints, float]:
    """About as many points as the settings ask for, spread evenly in space, of a scan that `began` at so many seconds.

    The spacing `side` (m) follows the scans: returns that of the next one. 0 for the first scan.
    """
    side = side or _FIRST_SIDE
    own = one_a_cell(points, side, settings.min_range, settings.max_range)
    chosen = np.hstack([points.take(own, axis=0), normals_at(points, own, _PATCH)])
    unknown = np.full(len(own), UNKNOWN, np.int32)
    if len(own) > 1.25 * settings.points:
        side *= 1.1
    elif len(own) < 0.8 * settings.points:
        side = max(side / 1.1, _FINEST_SIDE)
    if point_times is None or np.ptp(point_times) < _SHORTEST:
        at = began if point_times is None else began + float(np.mean(point_times))
        return TimedPoints(chosen, np.full(len(own), at), np.array([at]), unknown), side
    low, high = began + float(point_times.min()), began + float(point_times.max())
    pieces = math.ceil((high - low) / settings.knot_interval - 1e-3)
    return TimedPoints(chosen, began + point_times[own], np.linspace(low, high, pieces + 1), unknown), side


@compiled
def one_a_cell(points: Floats, side: float, nearest: float, farthest: float) -> NDArray[np.int64]:
    """The indices of the first of points (N, 3) in each cell of `side` (m), between two ranges (m)."""
    size = 1
    while size < 2 * len(points):
        size *= 2
    keys, chosen, count = np.full(size, -1, np.int64), np.empty(len(points), np.int64), 0
    for p in range(len(points)):
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        away = x * x + y * y + z * z
        if away < nearest * nearest or away > farthest * farthest:
            continue
        i, j, k = math.floor(x / side) + 1048576, math.floor(y / side) + 1048576, math.floor(z / side) + 1048576
        key = (((i << 21) | j) << 21) | k
        place = ((key * 0x9E3779B97F4A7C1) >> 21) & (size - 1)
        while keys[place] != -1 and keys[place] != key:
            place = (place + 1) & (size - 1)
        if keys[place] == -1:
            keys[place] = key
            chosen[count] = p
            count += 1
    return chosen[:count]


@compiled
def normals_at(points: Floats, chosen: Ints, side: float) -> Floats:
    """(M, 3) unit normals, of either sign, of a scan's surfaces at the chosen ones (M,) of its points (N, 3).

    They are those of all points in the same cell; zero where these are few, or not on one plane.
    """
    size = 1
    while size < 2 * len(points):
        size *= 2
    keys, sums, slots = np.full(size, -1, np.int64), np.zeros((size, 10)), np.empty(len(points), np.int64)
    for p in range(len(points)):
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        i, j, k = math.floor(x / side) + 1048576, math.floor(y / side) + 1048576, math.floor(z / side) + 1048576
        key = (((i << 21) | j) << 21) | k
        place = ((key * 0x9E3779B97F4A7C1) >> 21) & (size - 1)
        while keys[place] != -1 and keys[place] != key:
            place = (place + 1) & (size - 1)
        keys[place] = key
        slots[p] = place
        own = sums[place]
        own[0] += 1
        own[1] += x
        own[2] += y
        own[3] += z
        own[4] += x * x
        own[5] += x * y
        own[6] += x * z
        own[7] += y * y
        own[8] += y * z
        own[9] += z * z
    found, normals, C = np.zeros((size, 4)), np.zeros((len(chosen), 3)), np.empty((3, 3))
    for m in range(len(chosen)):
        place = slots[chosen[m]]
        own, n = sums[place], sums[place, 0]
        if found[place, 3] == 0.0:
            found[place, 3] = 1.0
            if n >= _LEAST:
                at = 4
                for i in range(3):
                    for j in range(i, 3):
                        C[i, j] = C[j, i] = own[at] / n - own[1 + i] * own[1 + j] / (n * n)
                        at += 1
                values, axes = eigen(C)
                if values[1] > _FLAT * max(values[0], _NOISE**2):
                    found[place, :3] = axes[:, 0]
        normals[m] = found[place, :3]
    return normals
