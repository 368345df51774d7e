"""Finds the plane of a surfel map that a point lies on, or that a ray meets."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from sgslam.surfels.planes import (
    ACROSS,
    GRAZING,
    OTHER,
    SEEN,
    SHIFT,
    SIDES,
    VALID,
    block_of,
    cell_of,
    is_within,
    key_of,
    off_plane,
    variance_at,
    within_block,
)

Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]
Ints = NDArray[np.int64]
Ints32 = NDArray[np.int32]
Vector = tuple[float, float, float]

_FINER = 0.5  # times the variance of a larger cell's plane, that of a smaller one's at most: beams have biases
_ALIKE = 0.5  # cosine between the normals of a point's surface and of its plane
_FITS = 2.0  # times the standard deviation: a point farther from its plane may be on one of the next cell
_BEYOND = 0.25  # m, by which a surface may go on beyond its seen extent in the next cell
FOLLOWED = 1  # of the grids, the one in which rays are followed


class Surfels(NamedTuple):
    """What a registration reads of a map: the hash table (T, 2), the first surfel of each block's cells (B, 73), and
    the planes (N, 16), see `sgslam.surfels.planes`. Surfel 0 is none."""

    table: Ints
    cells: Ints32
    planes: Floats32


@compiled
def _is_seen(point: Vector, sensor: Vector, planes: Floats32, s: int, oldest: float) -> bool:
    """Whether plane `s` is known, and a sensor (3,) stands before it, on the side that was seen, and looks at a point
    (3,) from there.

    Who has come to a slab's height no longer sees its underside.
    """
    if planes[s, VALID] == 0.0 or planes[s, SEEN] < oldest:
        return False
    x, y, z = sensor
    towards = planes[s, 0] * (point[0] - x) + planes[s, 1] * (point[1] - y) + planes[s, 2] * (point[2] - z)
    return bool(towards < 0 and off_plane(x, y, z, planes, s) > 0)


@compiled
def nearest_plane(
    point: Vector, sensor: Vector, normal: Vector, gate: float, error: float, surfels: Surfels, oldest: float
) -> int:
    """The plane within `gate` (m) of a point (3,) seen by a sensor at (3,), 0 for none.

    Where the scan itself shows the normal (3,) of its surface there (else zero), the plane's is within 60 degrees of
    it: the edge of a slab is not its floor.

    A point beyond a plane's extent, by more than its own `error` (m), is not on it: a wall's points are not on the
    ceiling that ends there. Of the planes in the cells of several sizes, that of the largest, unless a smaller one
    predicts the point clearly better: large cells give true normals, since beams have biases, and small ones follow
    what is not flat. Where it does not fit, the plane of the next cell may, if the point is near the border: a wall
    that goes on for a hand's breadth below a ceiling has no plane of its own there. A point of unknown normal that may
    be on two surfaces is on neither.
    """
    planes, (x, y, z), (nx, ny, nz) = surfels.planes, point, normal
    is_unknown = nx == 0.0 and ny == 0.0 and nz == 0.0
    cell = cell_of(x, y, z)
    block, chosen, lowest, distance = block_of(cell, surfels.table), 0, math.inf, math.inf
    levels, side = len(SIDES), SIDES[0]
    for look in range(levels + 3):
        best, least, margin = 0, gate, error
        if look < levels:
            s = surfels.cells[block, within_block(cell, look)]
        else:
            if chosen == 0 or distance < _FITS * math.sqrt(lowest):
                break
            axis = look - levels
            within = (point[axis] + SHIFT) - side * math.floor((point[axis] + SHIFT) / side)
            if _BEYOND < within < side - _BEYOND:
                continue
            step = -side if within < _BEYOND else side
            beyond = cell_of(x + step * (axis == 0), y + step * (axis == 1), z + step * (axis == 2))
            s = surfels.cells[block_of(beyond, surfels.table), 0]
            least, margin = distance / 2, error + _BEYOND
        while s > 0:
            is_alike = is_unknown or abs(planes[s, 0] * nx + planes[s, 1] * ny + planes[s, 2] * nz) > _ALIKE
            if is_alike and _is_seen(point, sensor, planes, s, oldest):
                off = abs(off_plane(x, y, z, planes, s))
                if off < least and is_within(x, y, z, planes, s, margin):
                    best, least = s, off
            s = np.int32(planes[s, OTHER])
        if best == 0:
            continue
        if look >= levels:
            chosen, distance = best, least
            continue
        variance = planes[best, ACROSS] + variance_at(x, y, z, planes, best)
        if variance < _FINER * lowest:
            chosen, lowest, distance = best, variance, least
    if is_unknown and chosen > 0 and _may_be_on_another(point, sensor, error, chosen, surfels, oldest):
        return 0
    return chosen


@compiled
def _may_be_on_another(
    point: Vector, sensor: Vector, error: float, chosen: int, surfels: Surfels, oldest: float
) -> bool:
    """Whether a point (3,) on the `chosen` plane may as well be on one of another direction, which ends near by.

    A ring of beams that leaves a ceiling goes on along the wall below it, at heights where that was not seen before:
    taken for the ceiling, it would lift the sensor.
    """
    planes = surfels.planes
    x, y, z = point
    nx, ny, nz = planes[chosen, 0], planes[chosen, 1], planes[chosen, 2]
    cell = cell_of(x + _BEYOND * nx, y + _BEYOND * ny, z + _BEYOND * nz)
    block = block_of(cell, surfels.table)
    for level in range(len(SIDES)):
        s = surfels.cells[block, within_block(cell, level)]
        while s > 0:
            is_alike = abs(nx * planes[s, 0] + ny * planes[s, 1] + nz * planes[s, 2]) > _ALIKE
            if not is_alike and _is_seen(point, sensor, planes, s, oldest):
                off = off_plane(x, y, z, planes, s)
                fits = off * off < _FITS**2 * (planes[s, ACROSS] + variance_at(x, y, z, planes, s))
                if fits and is_within(x, y, z, planes, s, error + _BEYOND):
                    return True
            s = np.int32(planes[s, OTHER])
    return False


@compiled
def is_met_in(
    cell: tuple[int, int, int], sensor: Vector, ray: Vector, end: float, surfels: Surfels, oldest: float
) -> bool:
    """Whether the followed cell around a `cell` of the finest grid has a surface, of the side seen, that a unit ray
    (3,) from a sensor (3,) meets there, before its `end` (m)."""
    key, planes = key_of(cell, FOLLOWED), surfels.planes
    s = surfels.cells[block_of(cell, surfels.table), within_block(cell, FOLLOWED)]
    while s > 0:
        towards = planes[s, 0] * ray[0] + planes[s, 1] * ray[1] + planes[s, 2] * ray[2]
        if planes[s, VALID] > 0 and planes[s, SEEN] >= oldest and towards < -GRAZING:
            t = -off_plane(sensor[0], sensor[1], sensor[2], planes, s) / towards
            x, y, z = sensor[0] + t * ray[0], sensor[1] + t * ray[1], sensor[2] + t * ray[2]
            if 0 < t < end and key_of(cell_of(x, y, z), FOLLOWED) == key and is_within(x, y, z, planes, s, 0.0):
                return True
        s = np.int32(planes[s, OTHER])
    return False
