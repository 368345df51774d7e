"""The plane of a surfel map that each point of a moving sensor lies on."""

import os
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from sgslam.registration.moving_points import place_point, turn_between
from sgslam.surfels.search import Surfels, nearest_plane

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def planes_of(
    points: Floats, knot: Ints, share: Floats, knots: Floats, surfels: Surfels, oldest: float, gate: float, error: float
) -> tuple[Floats, Ints]:
    """What `find_planes` finds: `moved` (N, 3) and the plane (N,) of each point. Half of it in another thread: it is
    most of the work of a registration."""
    moved, plane_of = np.empty((len(points), 3)), np.empty(len(points), np.int64)

    def find(own: slice) -> None:
        find_planes(points[own], knot[own], share[own], knots, surfels, oldest, gate, error, moved[own], plane_of[own])

    half = len(points) // 2
    other = _helper(os.getpid()).submit(find, slice(half))
    find(slice(half, None))
    if other.cancel():  # no core was free for it
        find(slice(half))
    else:
        other.result()
    return moved, plane_of


@lru_cache(maxsize=1)
def _helper(process: int) -> ThreadPoolExecutor:
    """A thread of this process: those of its parent are not there after a fork."""
    return ThreadPoolExecutor(1)


@compiled
def find_planes(
    points: Floats, knot: Ints, share: Floats, knots: Floats, surfels: Surfels, oldest: float, gate: float,
    error: float, moved: Floats, plane_of: Ints,
) -> None:  # fmt: skip
    """Fills in where points (N, 6) are in `odom`, `moved` (N, 3), and the plane (N,) of each, -1 for none.

    A plane is within `gate` (m) of its point, whose place is known to an `error` (m).
    """
    turns, ray, normal, sensor = np.empty((len(knots), 3)), np.empty(3), np.empty(3), np.empty(3)
    for k in range(len(knots) - 1):
        turns[k] = turn_between(knots[k], knots[k + 1])
    for p in range(len(points)):
        place_point(points[p], knot[p], share[p], knots, turns, moved[p], ray)
        T, q = knots[knot[p]], points[p]
        for i in range(3):
            normal[i] = T[i, 0] * q[3] + T[i, 1] * q[4] + T[i, 2] * q[5]
            sensor[i] = T[i, 3]
            if share[p] != 0.0:
                sensor[i] += share[p] * (knots[knot[p] + 1, i, 3] - T[i, 3])
        plane_of[p] = nearest_plane(moved[p], sensor, normal, gate, error, surfels, oldest)
