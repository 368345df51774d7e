"""Finds the plane of a surfel map that a point lies on, or that a ray meets."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from sgslam.surfels.cells import SHIFT, SIDES, key_of, place_of
from sgslam.surfels.planes import ACROSS, GRAZING, MEAN, NORMAL, VALID, in_plane, is_within, plane_residual

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Vector = Floats | tuple[float, float, float]

_FINER = 0.5  # times the variance of a larger cell's plane, that of a smaller one's at most: beams have biases
_ALIKE = 0.5  # cosine between the normals of a point's surface and of its plane
_FITS = 2.0  # times the standard deviation: a point farther from its plane may be on one of the next cell
_BEYOND = 0.25  # m, by which a surface may go on beyond its seen extent in the next cell
FOLLOWED = 1  # of the grids, the one in which rays are followed


class Surfels(NamedTuple):
    """What a registration reads of a map: the hash table, each surfel's other side, planes, and when they were seen."""

    keys: Ints
    first: Ints
    other: Ints
    planes: Floats
    seen: Floats


@compiled
def _seen_from(point: Vector, sensor: Vector, planes: Floats, s: int) -> bool:
    """Whether a sensor (3,) stands before plane `s`, on the side that was seen, and looks at a point (3,) from there.

    Who has come to a slab's height no longer sees its underside.
    """
    nx, ny, nz = planes[s, NORMAL], planes[s, NORMAL + 1], planes[s, NORMAL + 2]
    x, y, z = sensor[0], sensor[1], sensor[2]
    towards = nx * (point[0] - x) + ny * (point[1] - y) + nz * (point[2] - z)
    before = nx * (x - planes[s, MEAN]) + ny * (y - planes[s, MEAN + 1]) + nz * (z - planes[s, MEAN + 2])
    return bool(towards < 0 and before > 0)


@compiled
def nearest_plane(
    point: Vector, sensor: Vector, normal: Vector, gate: float, error: float, surfels: Surfels, oldest: float
) -> int:
    """The plane within `gate` (m) of a point (3,) seen by a sensor at (3,), -1 for none.

    Where the scan itself shows the normal (3,) of its surface there (else zero), the plane's is within 60 degrees of
    it: the edge of a slab is not its floor.

    A point beyond a plane's extent, by more than its own `error` (m), is not on it: a wall's points are not on the
    ceiling that ends there. Of the planes in the cells of several sizes, that of the largest, unless a smaller one
    predicts the point clearly better: large cells give true normals, since beams have biases, and small ones follow
    what is not flat. Where it does not fit, the plane of the next cell may, if the point is near the border: a wall
    that goes on for a hand's breadth below a ceiling has no plane of its own there. A point of unknown normal that may
    be on two surfaces is on neither.
    """
    keys, first, other, planes, seen = surfels
    x, y, z = point
    nx, ny, nz = normal
    unknown = nx == 0.0 and ny == 0.0 and nz == 0.0
    chosen, lowest, distance = -1, math.inf, math.inf
    levels, largest = len(SIDES), SIDES[0]
    for cell in range(levels + 3):
        if cell < levels:
            key, best, least, margin = key_of(x, y, z, cell), -1, gate, error
        else:
            if chosen < 0 or distance < _FITS * math.sqrt(lowest):
                break
            axis = cell - levels
            within = (point[axis] + SHIFT) % largest
            if _BEYOND < within < largest - _BEYOND:
                continue
            step = -largest if within < _BEYOND else largest
            key = key_of(x + step * (axis == 0), y + step * (axis == 1), z + step * (axis == 2), 0)
            best, least, margin = -1, distance / 2, error + _BEYOND
        place = place_of(key, keys)
        s = first[place] if keys[place] == key else -1
        while s >= 0:
            alike = unknown or abs(planes[s, 0] * nx + planes[s, 1] * ny + planes[s, 2] * nz) > _ALIKE
            if alike and seen[s] >= oldest and planes[s, VALID] > 0 and _seen_from(point, sensor, planes, s):
                off, _ = plane_residual(x, y, z, planes, s)
                if abs(off) < least and is_within(x, y, z, planes, s, margin):
                    best, least = s, abs(off)
            s = other[s]
        if best < 0:
            continue
        if cell >= levels:
            chosen, distance = best, least
            continue
        _, spread = plane_residual(x, y, z, planes, best)
        if planes[best, ACROSS] + spread < _FINER * lowest:
            chosen, lowest, distance = best, planes[best, ACROSS] + spread, least
    if unknown and chosen >= 0 and _may_be_on_another(point, sensor, error, chosen, surfels, oldest):
        chosen = -1
    return chosen


@compiled
def _may_be_on_another(
    point: Vector, sensor: Vector, error: float, chosen: int, surfels: Surfels, oldest: float
) -> bool:
    """Whether a point (3,) on the `chosen` plane may as well be on one of another direction, which ends near by.

    A ring of beams that leaves a ceiling goes on along the wall below it, at heights where that was not seen before:
    taken for the ceiling, it would lift the sensor.
    """
    keys, first, other, planes, seen = surfels
    x, y, z = point
    nx, ny, nz = planes[chosen, 0], planes[chosen, 1], planes[chosen, 2]
    for cell in range(len(SIDES)):
        key = key_of(x + _BEYOND * nx, y + _BEYOND * ny, z + _BEYOND * nz, cell)
        place = place_of(key, keys)
        s = first[place] if keys[place] == key else -1
        while s >= 0:
            alike = abs(nx * planes[s, 0] + ny * planes[s, 1] + nz * planes[s, 2]) > _ALIKE
            if not alike and seen[s] >= oldest and planes[s, VALID] > 0 and _seen_from(point, sensor, planes, s):
                off, spread = plane_residual(x, y, z, planes, s)
                fits = off * off < _FITS**2 * (planes[s, ACROSS] + spread)
                if fits and is_within(x, y, z, planes, s, error + _BEYOND):
                    return True
            s = other[s]
    return False


@compiled
def is_met_in(key: int, sensor: Floats, ray: Floats, end: float, surfels: Surfels, oldest: float) -> bool:
    """Whether the cell with a key has a surface, of the side seen, that a unit ray (3,) from a sensor (3,) meets there,
    before its `end` (m)."""
    keys, first, other, planes, seen = surfels
    place = place_of(key, keys)
    s = first[place] if keys[place] == key else -1
    while s >= 0:
        towards = planes[s, 0] * ray[0] + planes[s, 1] * ray[1] + planes[s, 2] * ray[2]
        if planes[s, VALID] > 0 and seen[s] >= oldest and towards < -GRAZING:
            before, _, _ = in_plane(sensor[0], sensor[1], sensor[2], planes, s)
            t = -before / towards
            x, y, z = sensor[0] + t * ray[0], sensor[1] + t * ray[1], sensor[2] + t * ray[2]
            if 0 < t < end and key_of(x, y, z, FOLLOWED) == key and is_within(x, y, z, planes, s, 0.0):
                return True
        s = other[s]
    return False
