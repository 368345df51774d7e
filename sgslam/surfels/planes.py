"""The cells of a surfel map, in a hash table of blocks of one cubic metre, and the planes of its surfels."""

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from sgslam.config.sensor import SENSOR
from sgslam.geometry.compiled import principal_axes

Ints = NDArray[np.int64]
Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]
SIDES = (1.0, 0.5, 0.25)  # m, of the cells
SHIFT = 0.11  # m, of the cells: walls at round distances from where a run begins are not on their borders
CELLS = sum(round(SIDES[0] / side) ** 3 for side in SIDES)  # of a block: one of the coarsest grid, then 8, then 64
_BITS = 21  # of a cell's index along one axis
HALF = 2.0 ** (_BITS - 1)  # cells, so that no index is negative
_LEAST = 6  # points that a plane needs
FULL = 200.0  # points after which a surfel stays as it is: its mean is known to a millimetre
_THICK = 0.06  # m, the largest standard deviation across a plane: furniture and corners are none
_FLAT = 9.0  # times the variance across, that along the plane in its narrower direction at least
_UNEVEN = 2.0  # times the usual variance across planes, that of one that is not flat
_BELIEVED = 5.0  # points with the noise of a range, added to a plane's own: few may spread less by chance
_EXTENT = 2.0  # times the standard deviation of a plane's points along it, its half width: beyond, it was not seen
GRAZING = 0.1  # sine of the angle between rays and plane, at least: one ring around a corner of a room is none
# columns of a surfel's sums; CHANGED is 1 until its plane is fitted again
COUNT, SUM, SQUARES, RAY, CHANGED = 0, 1, 4, 10, 13
SUMS = CHANGED + 1
# Columns of a surfel's plane, a cache line. The second axis is the normal times the first. The halves (m) are those of
# the extent along the axes. The plane's variance is that at its mean, ACROSS that of its points. SEEN is the way (m)
# at which it was last seen, and OTHER the next surfel of its cell, of another side.
NORMAL, MEAN, AXIS, HALF_1, HALF_2, VARIANCE, ACROSS, VALID, SEEN, OTHER = 0, 3, 6, 9, 10, 11, 12, 13, 14, 15
PLANE = OTHER + 1


@compiled
def cell_of(x: float, y: float, z: float) -> tuple[int, int, int]:
    """The indices of the cell of the finest grid that holds a point (m); none is negative."""
    half = HALF + SHIFT / SIDES[2]
    return int(x / SIDES[2] + half), int(y / SIDES[2] + half), int(z / SIDES[2] + half)


@compiled
def key_of(cell: tuple[int, int, int], level: int) -> int:
    """The key, never zero, of the cell of grid `level` around a `cell` of the finest one."""
    up = 2 - level
    return ((((cell[0] >> up) << _BITS) | (cell[1] >> up)) << _BITS) | (cell[2] >> up)


@compiled
def place_of(key: int, table: Ints) -> int:
    """The row of a block's key in the hash `table` (T, 2) of keys and blocks, or the empty one where it belongs."""
    mask = len(table) - 1
    place = ((key * 0x9E3779B97F4A7C1) >> 21) & mask
    while table[place, 0] != 0 and table[place, 0] != key:
        place = (place + 1) & mask
    return place


@compiled
def block_of(cell: tuple[int, int, int], table: Ints) -> int:
    """The block that holds a `cell` of the finest grid; block 0, which has no surfels, where there is none."""
    return table[place_of(key_of(cell, 0), table), 1]


@compiled
def within_block(cell: tuple[int, int, int], level: int) -> int:
    """The column, of a block's row, of the cell of grid `level` around a `cell` of the finest one."""
    up, last = 2 - level, (1 << level) - 1
    i, j, k = (cell[0] >> up) & last, (cell[1] >> up) & last, (cell[2] >> up) & last
    return (level + (level == 2) * 7) + ((((i << level) | j) << level) | k)


@compiled
def rehash(table: Ints, larger: Ints) -> None:
    """Copies all blocks to a larger table."""
    for i in range(len(table)):
        if table[i, 0] != 0:
            place = place_of(table[i, 0], larger)
            for k in range(table.shape[1]):
                larger[place, k] = table[i, k]


@compiled
def fit_plane(sums: Floats, planes: Floats32, s: int) -> None:
    """Fits the plane through a surfel's points, its normal towards the sensor."""
    n = sums[s, COUNT]
    sums[s, CHANGED], planes[s, VALID] = 0.0, 0.0
    if n < _LEAST:
        return
    x, y, z = sums[s, SUM] / n, sums[s, SUM + 1] / n, sums[s, SUM + 2] / n
    xx, xy, xz = sums[s, SQUARES] / n - x * x, sums[s, SQUARES + 1] / n - x * y, sums[s, SQUARES + 2] / n - x * z
    yy, yz, zz = sums[s, SQUARES + 3] / n - y * y, sums[s, SQUARES + 4] / n - y * z, sums[s, SQUARES + 5] / n - z * z
    values, normal, axis = principal_axes(xx, xy, xz, yy, yz, zz)
    across = values[0] * n / (n - 3)  # a plane has three degrees of freedom
    if across > _THICK**2 or values[1] < _FLAT * max(across, SENSOR.range_noise**2 / 4):
        return
    towards = sums[s, RAY] * normal[0] + sums[s, RAY + 1] * normal[1] + sums[s, RAY + 2] * normal[2]
    if abs(towards) < GRAZING * n:
        return
    sign = -1.0 if towards > 0 else 1.0
    planes[s, NORMAL], planes[s, NORMAL + 1], planes[s, NORMAL + 2] = (
        sign * normal[0],
        sign * normal[1],
        sign * normal[2],
    )
    planes[s, MEAN], planes[s, MEAN + 1], planes[s, MEAN + 2] = x, y, z
    planes[s, AXIS], planes[s, AXIS + 1], planes[s, AXIS + 2] = axis
    planes[s, HALF_1], planes[s, HALF_2] = _EXTENT * np.sqrt(values[1]), _EXTENT * np.sqrt(values[2])
    planes[s, ACROSS] = (across * (n - 3) + SENSOR.range_noise**2 * _BELIEVED) / (n - 3 + _BELIEVED)
    planes[s, VARIANCE] = planes[s, ACROSS] / n + SENSOR.shared_noise**2
    planes[s, VALID] = 1.0


@compiled
def off_plane(x: float, y: float, z: float, planes: Floats32, s: int) -> float:
    """The distance (m) of a point from plane `s`, on the side that was seen."""
    dx, dy, dz = x - planes[s, MEAN], y - planes[s, MEAN + 1], z - planes[s, MEAN + 2]
    return planes[s, 0] * dx + planes[s, 1] * dy + planes[s, 2] * dz


@compiled
def along_plane(x: float, y: float, z: float, planes: Floats32, s: int) -> tuple[float, float]:
    """A point relative to the mean of plane `s` (m), along both axes of the plane."""
    dx, dy, dz = x - planes[s, MEAN], y - planes[s, MEAN + 1], z - planes[s, MEAN + 2]
    ax, ay, az = planes[s, AXIS], planes[s, AXIS + 1], planes[s, AXIS + 2]
    nx, ny, nz = planes[s, 0], planes[s, 1], planes[s, 2]
    bx, by, bz = ny * az - nz * ay, nz * ax - nx * az, nx * ay - ny * ax
    return ax * dx + ay * dy + az * dz, bx * dx + by * dy + bz * dz


@compiled
def variance_at(x: float, y: float, z: float, planes: Floats32, s: int) -> float:
    """The variance (m2) of plane `s` at a point, as of a linear regression."""
    a, b = along_plane(x, y, z, planes, s)
    a, b = a / planes[s, HALF_1], b / planes[s, HALF_2]
    return planes[s, VARIANCE] * (1 + _EXTENT**2 * (a * a + b * b))


@compiled
def is_within(x: float, y: float, z: float, planes: Floats32, s: int, error: float) -> bool:
    """Whether a point whose place has an `error` (m) may lie on the part of plane `s` that was seen."""
    a, b = along_plane(x, y, z, planes, s)
    a, b = a / (planes[s, HALF_1] + error), b / (planes[s, HALF_2] + error)
    return a * a + b * b < 1


@compiled
def misfit(planes: Floats32, s: int, typical: float) -> float:
    """The variance (m2) across a plane beyond that of a flat one, where the `typical` variance (m2) is that of most."""
    return max(planes[s, ACROSS] - max(_UNEVEN * typical, SENSOR.range_noise**2), 0.0)


@compiled
def add_normal_variance(planes: Floats32, s: int, moments: Floats, F: Floats) -> None:
    """Adds to the upper triangle of F (6, 6) what an error of a plane's normal does to the Jacobians of the distances
    of points from it; rotation first.

    The `moments` (10,) of the points relative to the sensor are the sums of their weights, times 1, x, y, z, xx, xy,
    xz, yy, yz and zz.
    """
    w, x, y, z, xx, xy, xz, yy, yz, zz = moments
    nx, ny, nz = planes[s, 0], planes[s, 1], planes[s, 2]
    ax, ay, az = planes[s, AXIS], planes[s, AXIS + 1], planes[s, AXIS + 2]
    second = (ny * az - nz * ay, nz * ax - nx * az, nx * ay - ny * ax)
    for axis, half in (((ax, ay, az), planes[s, HALF_1]), (second, planes[s, HALF_2])):
        a, b, c = axis
        own = planes[s, VARIANCE] * _EXTENT**2 / (half * half)
        # the Jacobian's change is (point x axis, axis)
        F[0, 0] += own * (yy * c * c - 2 * yz * b * c + zz * b * b)
        F[0, 1] += own * (yz * a * c - xy * c * c - zz * a * b + xz * b * c)
        F[0, 2] += own * (xy * b * c - yy * a * c - xz * b * b + yz * a * b)
        F[1, 1] += own * (zz * a * a - 2 * xz * a * c + xx * c * c)
        F[1, 2] += own * (xz * a * b - yz * a * a - xx * b * c + xy * a * c)
        F[2, 2] += own * (xx * b * b - 2 * xy * a * b + yy * a * a)
        turned = (y * c - z * b, z * a - x * c, x * b - y * a)
        for i in range(3):
            for j in range(3):
                F[i, 3 + j] += own * turned[i] * axis[j]
            for j in range(i, 3):
                F[3 + i, 3 + j] += own * w * axis[i] * axis[j]
