"""The plane of a surfel: how it is fitted to the sums of its points, and how a point lies to it."""

import math

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from sgslam.geometry.normal_equations import eigen

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_LEAST = 6  # points that a plane needs
_THICK = 0.06  # m, the largest standard deviation across a plane: furniture and corners are none
_FLAT = 9.0  # times the variance across, that along the plane in its narrower direction at least
_NOISE = 0.02  # m, standard deviation of a range; the spread of few points may be less by chance
_SHARED = 0.0025  # m, standard deviation of what all points of a patch share: walls and ranges are no truer
_UNEVEN = 2.0  # times the usual variance across planes, that of one that is not flat
_BELIEVED = 5.0  # points of that noise, added to a plane's own
_EXTENT = 2.0  # times the standard deviation of a plane's points along it, its half width: beyond, it was not seen
GRAZING = 0.1  # sine of the angle between rays and plane, at least: one ring around a corner of a room is none
# columns of a surfel's row
COUNT, SUM, SQUARES, RAY, CHANGED = 0, 1, 4, 10, 13
SUMS = 14
# columns of a plane's row; the spread is (1 + a^2/l1 + b^2/l2) l0/n, as in a linear regression
NORMAL, MEAN, AXIS_1, AXIS_2, VARIANCE, INVERSE_1, INVERSE_2, VALID, ACROSS = 0, 3, 6, 9, 12, 13, 14, 15, 16
PLANE = 17


@compiled
def fit_plane(own: Floats, plane: Floats) -> None:
    """Fits the plane through a surfel's points, its normal towards the sensor."""
    n = own[COUNT]
    plane[VALID] = 0.0
    if n < _LEAST:
        return
    C, mean = np.empty((3, 3)), own[SUM : SUM + 3] / n
    k = SQUARES
    for i in range(3):
        for j in range(i, 3):
            C[i, j] = C[j, i] = own[k] / n - mean[i] * mean[j]
            k += 1
    values, axes = eigen(C)
    across = values[0] * n / (n - 3)  # a plane has three degrees of freedom
    if across > _THICK**2 or values[1] < _FLAT * max(across, _NOISE**2 / 4):
        return
    towards = own[RAY] * axes[0, 0] + own[RAY + 1] * axes[1, 0] + own[RAY + 2] * axes[2, 0]
    if abs(towards) < GRAZING * n:
        return
    sign = -1.0 if towards > 0 else 1.0
    for i in range(3):
        plane[NORMAL + i], plane[MEAN + i] = sign * axes[i, 0], mean[i]
        plane[AXIS_1 + i], plane[AXIS_2 + i] = axes[i, 1], axes[i, 2]
    plane[ACROSS] = (across * (n - 3) + _NOISE**2 * _BELIEVED) / (n - 3 + _BELIEVED)
    plane[VARIANCE] = plane[ACROSS] / n + _SHARED**2
    plane[INVERSE_1], plane[INVERSE_2] = 1 / values[1], 1 / values[2]
    plane[VALID] = 1.0


@compiled
def in_plane(x: float, y: float, z: float, planes: Floats, s: int) -> tuple[float, float, float]:
    """A point relative to the mean of plane `s` of `planes` (m): along the normal and along both axes of the plane."""
    dx, dy, dz = x - planes[s, MEAN], y - planes[s, MEAN + 1], z - planes[s, MEAN + 2]
    return (
        planes[s, 0] * dx + planes[s, 1] * dy + planes[s, 2] * dz,
        planes[s, AXIS_1] * dx + planes[s, AXIS_1 + 1] * dy + planes[s, AXIS_1 + 2] * dz,
        planes[s, AXIS_2] * dx + planes[s, AXIS_2 + 1] * dy + planes[s, AXIS_2 + 2] * dz,
    )


@compiled
def plane_residual(x: float, y: float, z: float, planes: Floats, s: int) -> tuple[float, float]:
    """The distance (m) of a point from a plane, and the variance (m2) of the plane there, as of a linear regression."""
    off, a, b = in_plane(x, y, z, planes, s)
    spread = planes[s, VARIANCE] * (1 + a * a * planes[s, INVERSE_1] + b * b * planes[s, INVERSE_2])
    return off, spread


@compiled
def is_within(x: float, y: float, z: float, planes: Floats, s: int, error: float) -> bool:
    """Whether a point whose place has an `error` (m) may lie on the part of a plane that was seen."""
    _, a, b = in_plane(x, y, z, planes, s)
    a /= _EXTENT / math.sqrt(planes[s, INVERSE_1]) + error
    b /= _EXTENT / math.sqrt(planes[s, INVERSE_2]) + error
    return a * a + b * b < 1


@compiled
def typical_variance(planes: Floats, plane_of: Ints) -> float:
    """The median variance (m2) across the planes (N,) of points, -1 for none: that of the sensor's ranges."""
    across = planes[:, ACROSS][plane_of[plane_of >= 0]]
    return float(np.median(across)) if len(across) else 0.0


@compiled
def misfit(planes: Floats, s: int, typical: float) -> float:
    """The variance (m2) across a plane beyond that of a flat one, where the `typical` variance (m2) is that of most."""
    return max(planes[s, ACROSS] - max(_UNEVEN * typical, _NOISE**2), 0.0)


@compiled
def add_normal_variance(
    planes: Floats, s: int, x: float, y: float, z: float, weight: float, D: Floats, F: Floats
) -> None:
    """Adds to the upper triangle of F (6, 6), times a weight, what an error of a plane's normal does to the Jacobian of
    the distance of a point at (x, y, z) from the sensor; rotation first. D (6,) is room to work in."""
    for first, inverse in ((AXIS_1, planes[s, INVERSE_1]), (AXIS_2, planes[s, INVERSE_2])):
        ax, ay, az = planes[s, first], planes[s, first + 1], planes[s, first + 2]
        D[0], D[1], D[2] = y * az - z * ay, z * ax - x * az, x * ay - y * ax
        D[3], D[4], D[5] = ax, ay, az
        own = weight * planes[s, VARIANCE] * inverse
        for i in range(6):
            for j in range(i, 6):
                F[i, j] += own * D[i] * D[j]
