"""A local map of oriented surfels: planes in the cells of three grids that know the side from which they were seen.

Each cell keeps running sums of its points, and the plane through them (VoxelMap; Yuan et al., RA-L 2022). A thin wall
has two faces within one cell: points join a surfel only from the side it was seen from, or scans of the next room
would slip by the wall's thickness.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from sgslam.geometry.normal_equations import eigen
from sgslam.serialization import Stateful

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

SIDES = (1.0, 0.5, 0.25)  # m, of the cells
_LEAST = 6  # points that a plane needs
_FULL = 200.0  # points after which a surfel stays as it is: its mean is known to a millimetre
_THICK = 0.06  # m, the largest standard deviation across a plane: furniture and corners are none
_FLAT = 9.0  # times the variance across, that along the plane in its narrower direction at least
_NOISE = 0.02  # m, standard deviation of a range; the spread of few points may be less by chance
_SHARED = 0.0025  # m, standard deviation of what all points of a patch share: walls and ranges are no truer
_UNEVEN = 2.0  # times the usual variance across planes, that of one that is not flat
_BELIEVED = 5.0  # points of that noise, added to a plane's own
_FINER = 0.5  # times the variance of a larger cell's plane, that of a smaller one's at most: beams have biases
_ALIKE = 0.5  # cosine between the normals of a point's surface and of its plane
_EXTENT = 2.0  # times the standard deviation of a plane's points along it, its half width: beyond, it was not seen
_FITS = 2.0  # times the standard deviation: a point farther from its plane may be on one of the next cell
_BEYOND = 0.25  # m, by which a surface may go on beyond its seen extent in the next cell
_GRAZING = 0.1  # sine of the angle between rays and plane, at least: one ring around a corner of a room is none
_SHIFT = 0.11  # m, of the cells: walls at round distances from where a run begins are not on their borders
_BITS = 20  # of a cell's index along one axis
_FOLLOWED = 1  # of the grids, the one in which rays are followed
# columns of a surfel's row
_COUNT, _SUM, _SQUARES, _RAY, _CHANGED = 0, 1, 4, 10, 13
_SUMS = 14
# columns of a plane's row; the spread is (1 + a^2/l1 + b^2/l2) l0/n, as in a linear regression
_NORMAL, _MEAN, _AXIS_1, _AXIS_2, _VARIANCE, _INVERSE_1, _INVERSE_2, _VALID, _ACROSS = 0, 3, 6, 9, 12, 13, 14, 15, 16
_PLANE = 17


class Surfels(NamedTuple):
    """What a registration reads of a map: the hash table, each surfel's other side, planes, and when they were seen."""

    keys: Ints
    first: Ints
    other: Ints
    planes: Floats
    seen: Floats


class SurfelMap(Stateful):
    """Surfels in the `odom` frame. `planes` (N, 17) are documented by the names of their columns."""

    _STATE = ("count", "_keys", "_first", "_other", "_sums", "planes", "_seen")

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forgets everything."""
        self.count = 0
        self._keys, self._first = np.full(1 << 14, -1, np.int64), np.full(1 << 14, -1, np.int64)
        self._other = np.full(1 << 12, -1, np.int64)  # of each surfel, the one of its cell's other side
        self._sums, self.planes = np.zeros((1 << 12, _SUMS)), np.zeros((1 << 12, _PLANE))
        self._seen = np.zeros(1 << 12)  # m of way at which it was last seen

    def state(self) -> dict[str, Any]:
        """See `Stateful`; without the arrays' room for more."""
        rows = {name: getattr(self, name)[: self.count] for name in ("_other", "_sums", "planes", "_seen")}
        return {**super().state(), **rows}

    def restore(self, state: dict[str, Any]) -> None:
        """See `Stateful`."""
        super().restore(state)
        self._make_room(1)

    def add(self, points: Floats, rays: Floats, way: float, memory: float) -> None:
        """Adds points (N, 3) seen along unit rays (N, 3), both in `odom`, after `way` metres.

        Surfels that were not seen for `memory` metres start again.
        """
        self._make_room(2 * len(SIDES) * len(points))
        self.count = _add(
            points, rays, self._keys, self._first, self._other, self._sums, self.planes, self._seen, self.count, way,
            memory,
        )  # fmt: skip

    @property
    def arrays(self) -> Surfels:
        """The arrays themselves, not copies."""
        return Surfels(self._keys, self._first, self._other, self.planes, self._seen)

    def surfels(self) -> tuple[Floats, Floats, Floats]:
        """Means (N, 3), normals (N, 3) to the side seen from, and numbers of points (N,) of all planes."""
        own = np.flatnonzero(self.planes[: self.count, _VALID] > 0)
        return self.planes[own, _MEAN:_AXIS_1], self.planes[own, _NORMAL:_MEAN], self._sums[own, _COUNT]

    def _make_room(self, more: int) -> None:
        """Makes room for so many more surfels, and for as many again as there are."""
        if self.count + more > len(self._other):
            room = max(2 * self.count, self.count + more) - len(self._other)
            self._other = np.concatenate([self._other, np.full(room, -1, np.int64)])
            self._sums = np.concatenate([self._sums, np.zeros((room, _SUMS))])
            self.planes = np.concatenate([self.planes, np.zeros((room, _PLANE))])
            self._seen = np.concatenate([self._seen, np.zeros(room)])
        while 2 * (self.count + more) > len(self._keys):
            keys, first = self._keys, self._first
            self._keys, self._first = np.full(2 * len(keys), -1, np.int64), np.full(2 * len(keys), -1, np.int64)
            _rehash(keys, first, self._keys, self._first)


@compiled
def _key(x: float, y: float, z: float, level: int) -> int:
    half, side = 1 << (_BITS - 1), SIDES[level]
    i = math.floor((x + _SHIFT) / side) + half
    j = math.floor((y + _SHIFT) / side) + half
    k = math.floor((z + _SHIFT) / side) + half
    return int((((((i << _BITS) | j) << _BITS) | k) << 2) | level)


@compiled
def _place(key: int, keys: Ints) -> int:
    """The place of a key in the hash table, or of the empty one where it belongs."""
    mask = len(keys) - 1
    place = ((key * 0x9E3779B97F4A7C1) >> 21) & mask
    while keys[place] != -1 and keys[place] != key:
        place = (place + 1) & mask
    return int(place)


@compiled
def _rehash(keys: Ints, first: Ints, new_keys: Ints, new_first: Ints) -> None:
    for i in range(len(keys)):
        if keys[i] != -1:
            place = _place(keys[i], new_keys)
            new_keys[place], new_first[place] = keys[i], first[i]


@compiled
def _same_side(sums: Floats, plane: Floats, rx: float, ry: float, rz: float) -> bool:
    """Whether a ray meets a surfel on the side that was seen: of its plane, or before it has one, of its rays."""
    if plane[_VALID] > 0:
        return bool(plane[0] * rx + plane[1] * ry + plane[2] * rz < 0)
    return bool(sums[_RAY] * rx + sums[_RAY + 1] * ry + sums[_RAY + 2] * rz > 0)


@compiled
def _add(
    points: Floats, rays: Floats, keys: Ints, first: Ints, other: Ints, sums: Floats, planes: Floats, seen: Floats,
    count: int, way: float, memory: float,
) -> int:  # fmt: skip
    """Adds points to the sums of their cells and fits the planes that changed; returns the number of surfels."""
    touched = np.empty(len(SIDES) * len(points), np.int64)
    changed = 0
    for p in range(len(points)):
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        rx, ry, rz = rays[p, 0], rays[p, 1], rays[p, 2]
        for level in range(len(SIDES)):
            key = _key(x, y, z, level)
            place = _place(key, keys)
            s, before = first[place] if keys[place] == key else -1, -1
            while s >= 0 and seen[s] >= way - memory and not _same_side(sums[s], planes[s], rx, ry, rz):
                s, before = other[s], s
            if s < 0:
                s, count = count, count + 1
                if before >= 0:
                    other[before] = s
                else:
                    keys[place], first[place] = key, s
            elif seen[s] < way - memory:
                sums[s, :], planes[s, :] = 0.0, 0.0
            seen[s] = way
            own = sums[s]
            if own[_COUNT] >= _FULL:
                continue
            own[_COUNT] += 1
            own[_SUM] += x
            own[_SUM + 1] += y
            own[_SUM + 2] += z
            own[_RAY] += rx
            own[_RAY + 1] += ry
            own[_RAY + 2] += rz
            own[_SQUARES] += x * x
            own[_SQUARES + 1] += x * y
            own[_SQUARES + 2] += x * z
            own[_SQUARES + 3] += y * y
            own[_SQUARES + 4] += y * z
            own[_SQUARES + 5] += z * z
            if own[_CHANGED] == 0:
                own[_CHANGED] = 1
                touched[changed] = s
                changed += 1
    for i in range(changed):
        s = touched[i]
        sums[s, _CHANGED] = 0
        _fit(sums[s], planes[s])
    return count


@compiled
def _fit(own: Floats, plane: Floats) -> None:
    """Fits the plane through a surfel's points, its normal towards the sensor."""
    n = own[_COUNT]
    plane[_VALID] = 0.0
    if n < _LEAST:
        return
    C, mean = np.empty((3, 3)), own[_SUM : _SUM + 3] / n
    k = _SQUARES
    for i in range(3):
        for j in range(i, 3):
            C[i, j] = C[j, i] = own[k] / n - mean[i] * mean[j]
            k += 1
    values, axes = eigen(C)
    across = values[0] * n / (n - 3)  # a plane has three degrees of freedom
    if across > _THICK**2 or values[1] < _FLAT * max(across, _NOISE**2 / 4):
        return
    towards = own[_RAY] * axes[0, 0] + own[_RAY + 1] * axes[1, 0] + own[_RAY + 2] * axes[2, 0]
    if abs(towards) < _GRAZING * n:
        return
    sign = -1.0 if towards > 0 else 1.0
    for i in range(3):
        plane[_NORMAL + i], plane[_MEAN + i] = sign * axes[i, 0], mean[i]
        plane[_AXIS_1 + i], plane[_AXIS_2 + i] = axes[i, 1], axes[i, 2]
    plane[_ACROSS] = (across * (n - 3) + _NOISE**2 * _BELIEVED) / (n - 3 + _BELIEVED)
    plane[_VARIANCE] = plane[_ACROSS] / n + _SHARED**2
    plane[_INVERSE_1], plane[_INVERSE_2] = 1 / values[1], 1 / values[2]
    plane[_VALID] = 1.0


@compiled
def _in_plane(x: float, y: float, z: float, plane: Floats) -> tuple[float, float, float]:
    """A point relative to a plane's mean (m): along the normal and along both axes of the plane."""
    dx, dy, dz = x - plane[_MEAN], y - plane[_MEAN + 1], z - plane[_MEAN + 2]
    return (
        plane[0] * dx + plane[1] * dy + plane[2] * dz,
        plane[_AXIS_1] * dx + plane[_AXIS_1 + 1] * dy + plane[_AXIS_1 + 2] * dz,
        plane[_AXIS_2] * dx + plane[_AXIS_2 + 1] * dy + plane[_AXIS_2 + 2] * dz,
    )


@compiled
def plane_residual(x: float, y: float, z: float, plane: Floats) -> tuple[float, float]:
    """The distance (m) of a point from a plane, and the variance (m2) of the plane there, as of a linear regression."""
    off, a, b = _in_plane(x, y, z, plane)
    spread = plane[_VARIANCE] * (1 + a * a * plane[_INVERSE_1] + b * b * plane[_INVERSE_2])
    return off, spread


@compiled
def _seen_from(point: Floats, sensor: Floats, plane: Floats) -> bool:
    """Whether a sensor (3,) stands before a plane, on the side that was seen, and looks at a point (3,) from there.

    Who has come to a slab's height no longer sees its underside.
    """
    towards, before = 0.0, 0.0
    for i in range(3):
        towards += plane[_NORMAL + i] * (point[i] - sensor[i])
        before += plane[_NORMAL + i] * (sensor[i] - plane[_MEAN + i])
    return towards < 0 and before > 0


@compiled
def _is_within(x: float, y: float, z: float, plane: Floats, error: float) -> bool:
    """Whether a point whose place has an `error` (m) may lie on the part of a plane that was seen."""
    _, a, b = _in_plane(x, y, z, plane)
    a /= _EXTENT / math.sqrt(plane[_INVERSE_1]) + error
    b /= _EXTENT / math.sqrt(plane[_INVERSE_2]) + error
    return a * a + b * b < 1


@compiled
def nearest_plane(
    point: Floats, sensor: Floats, normal: Floats, gate: float, error: float, surfels: Surfels, oldest: float
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
            key, best, least, margin = _key(x, y, z, cell), -1, gate, error
        else:
            if chosen < 0 or distance < _FITS * math.sqrt(lowest):
                break
            axis = cell - levels
            within = (point[axis] + _SHIFT) % largest
            if _BEYOND < within < largest - _BEYOND:
                continue
            step = -largest if within < _BEYOND else largest
            key = _key(x + step * (axis == 0), y + step * (axis == 1), z + step * (axis == 2), 0)
            best, least, margin = -1, distance / 2, error + _BEYOND
        place = _place(key, keys)
        s = first[place] if keys[place] == key else -1
        while s >= 0:
            plane = planes[s]
            alike = unknown or abs(plane[0] * nx + plane[1] * ny + plane[2] * nz) > _ALIKE
            if alike and seen[s] >= oldest and plane[_VALID] > 0 and _seen_from(point, sensor, plane):
                off, _ = plane_residual(x, y, z, plane)
                if abs(off) < least and _is_within(x, y, z, plane, margin):
                    best, least = s, abs(off)
            s = other[s]
        if best < 0:
            continue
        if cell >= levels:
            chosen, distance = best, least
            continue
        _, spread = plane_residual(x, y, z, planes[best])
        if planes[best, _ACROSS] + spread < _FINER * lowest:
            chosen, lowest, distance = best, planes[best, _ACROSS] + spread, least
    if unknown and chosen >= 0 and _may_be_on_another(point, sensor, error, planes[chosen], surfels, oldest):
        chosen = -1
    return chosen


@compiled
def _may_be_on_another(
    point: Floats, sensor: Floats, error: float, plane: Floats, surfels: Surfels, oldest: float
) -> bool:  # fmt: skip
    """Whether a point (3,) that may be on a plane may as well be on one of another direction, which ends near by.

    A ring of beams that leaves a ceiling goes on along the wall below it, at heights where that was not seen before:
    taken for the ceiling, it would lift the sensor.
    """
    keys, first, other, planes, seen = surfels
    x, y, z = point
    nx, ny, nz = _BEYOND * plane[0], _BEYOND * plane[1], _BEYOND * plane[2]
    for cell in range(len(SIDES)):
        key = _key(x + nx, y + ny, z + nz, cell)
        place = _place(key, keys)
        s = first[place] if keys[place] == key else -1
        while s >= 0:
            own = planes[s]
            alike = abs(plane[0] * own[0] + plane[1] * own[1] + plane[2] * own[2]) > _ALIKE
            if not alike and seen[s] >= oldest and own[_VALID] > 0 and _seen_from(point, sensor, own):
                off, spread = plane_residual(x, y, z, own)
                fits = off * off < _FITS**2 * (own[_ACROSS] + spread)
                if fits and _is_within(x, y, z, own, error + _BEYOND):
                    return True
            s = other[s]
    return False


@compiled
def is_met_between(sensor: Floats, ray: Floats, at: float, end: float, surfels: Surfels, oldest: float) -> bool:
    """Whether the cell `at` so many metres from a sensor (3,) along a unit ray (3,) has a surface, of the side seen,
    that the ray meets there, before its `end` (m)."""
    keys, first, other, planes, seen = surfels
    key = _key(sensor[0] + at * ray[0], sensor[1] + at * ray[1], sensor[2] + at * ray[2], _FOLLOWED)
    place = _place(key, keys)
    s = first[place] if keys[place] == key else -1
    while s >= 0:
        plane = planes[s]
        towards = plane[0] * ray[0] + plane[1] * ray[1] + plane[2] * ray[2]
        if plane[_VALID] > 0 and seen[s] >= oldest and towards < -_GRAZING:
            before, _, _ = _in_plane(sensor[0], sensor[1], sensor[2], plane)
            t = -before / towards
            x, y, z = sensor[0] + t * ray[0], sensor[1] + t * ray[1], sensor[2] + t * ray[2]
            if 0 < t < end and _key(x, y, z, _FOLLOWED) == key and _is_within(x, y, z, plane, 0.0):
                return True
        s = other[s]
    return False


@compiled
def typical_variance(planes: Floats, plane_of: Ints) -> float:
    """The median variance (m2) across the planes (N,) of points, -1 for none: that of the sensor's ranges."""
    across = planes[:, _ACROSS][plane_of[plane_of >= 0]]
    return float(np.median(across)) if len(across) else 0.0


@compiled
def misfit(plane: Floats, typical: float) -> float:
    """The variance (m2) across a plane beyond that of a flat one, where the `typical` variance (m2) is that of most."""
    return max(plane[_ACROSS] - max(_UNEVEN * typical, _NOISE**2), 0.0)


@compiled
def add_normal_variance(plane: Floats, x: float, y: float, z: float, weight: float, D: Floats, F: Floats) -> None:
    """Adds to the upper triangle of F (6, 6), times a weight, what an error of a plane's normal does to the Jacobian of
    the distance of a point at (x, y, z) from the sensor; rotation first. D (6,) is room to work in."""
    for first, inverse in ((_AXIS_1, plane[_INVERSE_1]), (_AXIS_2, plane[_INVERSE_2])):
        ax, ay, az = plane[first], plane[first + 1], plane[first + 2]
        D[0], D[1], D[2] = y * az - z * ay, z * ax - x * az, x * ay - y * ax
        D[3], D[4], D[5] = ax, ay, az
        own = weight * plane[_VARIANCE] * inverse
        for i in range(6):
            for j in range(i, 6):
                F[i, j] += own * D[i] * D[j]
