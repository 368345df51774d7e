"""The plane of a surfel map that each point of a moving sensor lies on."""

import os
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from sgslam.registration.moving_points import place_point, turns_between
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
    turns, sensor = turns_between(knots), np.empty(3)
    for p in range(len(points)):
        place_point(points, p, knot[p], share[p], knots, turns, moved, sensor)
        k, nx, ny, nz = knot[p], points[p, 3], points[p, 4], points[p, 5]
        normal = (
            knots[k, 0, 0] * nx + knots[k, 0, 1] * ny + knots[k, 0, 2] * nz,
            knots[k, 1, 0] * nx + knots[k, 1, 1] * ny + knots[k, 1, 2] * nz,
            knots[k, 2, 0] * nx + knots[k, 2, 1] * ny + knots[k, 2, 2] * nz,
        )
        point, at = (moved[p, 0], moved[p, 1], moved[p, 2]), (sensor[0], sensor[1], sensor[2])
        plane_of[p] = nearest_plane(point, at, normal, gate, error, surfels, oldest)
