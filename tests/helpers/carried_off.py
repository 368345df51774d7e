"""Scans of a sensor that is carried off under a cover."""

import functools

import numpy as np
from boxes import Array, pose, room, scan, scene_of


@functools.cache
def carried_off() -> list[tuple[int, Array]]:
    """A room, a cover over the sensor, and another room, in which it starts again; ten scans (N, 3) a second."""
    here = scene_of([*room(0, 0, 4, 3), (0, 1, 0, 0.5, 2, 2)])
    there = scene_of([*room(20, 0, 29, 7), (23, 2, 0, 24, 4, 2.6), (26, 5, 0, 27, 7, 2.6)])
    first = [scan(here, pose(2 + 0.03 * i, 1.5, 1, yaw=0.03 * i), seed=i) for i in range(20)]
    cap = [0.4 * np.random.default_rng(i).normal(size=(20, 3)) for i in range(8)]
    other = [scan(there, pose(25 + 0.03 * i, 2, 1, yaw=1 - 0.03 * i), seed=i) for i in range(30)]
    return [(10**8 * k, points) for k, points in enumerate([*first, *cap, *other])]
