"""What a scan sees through: rays that pass surfaces of the map on their way show that its pose is wrong."""

import math

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from sgslam.surfels.cells import cell_of, key_of
from sgslam.surfels.search import FOLLOWED, Surfels, is_met_in

Floats = NDArray[np.float64]
_EVERY = 8  # of the points, one whose ray is followed
_STEP = 0.15  # m along a ray, from one cell that is looked at to the next; less than a third of a cell
_BEFORE = 0.5  # m before its end, a ray may meet the surface that it has measured


@compiled
def shares_seen_through(points: Floats, sensor: Floats, surfels: Surfels, oldest: float) -> tuple[float, float]:
    """Of the rays from a sensor (3,) to points (N, 3), in `odom`, the share that passes through surfaces of the map;
    and of the surfaces, the cells of the map, that they meet, the share that they pass through.

    Where a person stood whom the sensor now passes, a third of its rays pass through a single surface.
    """
    rays, passed, (x, y, z) = 0, 0, (sensor[0], sensor[1], sensor[2])
    ends, through = np.empty(len(points), np.int64), np.empty(len(points), np.int64)
    for p in range(0, len(points), _EVERY):
        dx, dy, dz = points[p, 0] - x, points[p, 1] - y, points[p, 2] - z
        length = math.sqrt(dx * dx + dy * dy + dz * dz)
        ray = (dx / length, dy / length, dz / length)
        ends[rays] = key_of(cell_of(points[p, 0], points[p, 1], points[p, 2]), FOLLOWED)
        rays += 1
        at = _STEP
        while at < length - _BEFORE:
            cell = cell_of(x + at * ray[0], y + at * ray[1], z + at * ray[2])
            if is_met_in(cell, (x, y, z), ray, length - _BEFORE, surfels, oldest):
                through[passed] = key_of(cell, FOLLOWED)
                passed += 1
                break
            at += _STEP
    seen_through = len(np.unique(through[:passed]))
    met = seen_through + len(np.unique(ends[:rays]))
    return passed / max(rays, 1), seen_through / max(met, 1)
