"""What a scan sees through: rays that pass surfaces of the map on their way show that its pose is wrong."""

import math

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from sgslam.surfels.search import Surfels, is_met_between

Floats = NDArray[np.float64]
_EVERY = 8  # of the points, one whose ray is followed
_STEP = 0.15  # m along a ray, from one cell that is looked at to the next; less than a third of a cell
_BEFORE = 0.5  # m before its end, a ray may meet the surface that it has measured


@compiled
def share_seen_through(points: Floats, sensor: Floats, surfels: Surfels, oldest: float) -> float:
    """The share of rays from a sensor (3,) to points (N, 3), in `odom`, that pass through a surface of the map.

    Glass, people and doors let some through.
    """
    rays, through, u = 0, 0, np.empty(3)
    for p in range(0, len(points), _EVERY):
        u[:] = points[p] - sensor
        length = math.sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2])
        u /= length
        rays += 1
        at = _STEP
        while at < length - _BEFORE:
            if is_met_between(sensor, u, at, length - _BEFORE, surfels, oldest):
                through += 1
                break
            at += _STEP
    return through / max(rays, 1)
