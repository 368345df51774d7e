"""Places of points that were measured by a moving sensor."""

import math

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@compiled
def turn_between(T_a: Floats, T_b: Floats) -> Floats:
    """(3,) the rotation vector, of less than pi, from one pose (4, 4) to another, in axes of `odom`."""
    D, v = np.zeros((3, 3)), np.empty(3)
    for i in range(3):
        for j in range(3):
            for k in range(3):
                D[i, j] += T_b[i, k] * T_a[j, k]
    v[0], v[1], v[2] = (D[2, 1] - D[1, 2]) / 2, (D[0, 2] - D[2, 0]) / 2, (D[1, 0] - D[0, 1]) / 2
    sine = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    if sine > 1e-9:
        v *= math.atan2(sine, (D[0, 0] + D[1, 1] + D[2, 2] - 1) / 2) / sine
    return v


@compiled
def rotated_by(w: Floats, share: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A point rotated by a share of a rotation vector (3,), by Rodrigues' formula."""
    angle = math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    if angle < 1e-12:
        return x, y, z
    ax, ay, az = w[0] / angle, w[1] / angle, w[2] / angle
    c, s = math.cos(share * angle), math.sin(share * angle)
    along = (ax * x + ay * y + az * z) * (1 - c)
    return (
        x * c + (ay * z - az * y) * s + ax * along,
        y * c + (az * x - ax * z) * s + ay * along,
        z * c + (ax * y - ay * x) * s + az * along,
    )


@compiled
def placed(points: Floats, knot: Ints, share: Floats, knots: Floats) -> tuple[Floats, Floats]:
    """Points (N, 3) and their unit rays (N, 3) in `odom`.

    Each point was measured by a sensor that had moved a `share` of the way from knot to next knot; `knots` (K, 4, 4)
    are its poses there.
    """
    turns = np.empty((len(knots), 3))
    for k in range(len(knots) - 1):
        turns[k] = turn_between(knots[k], knots[k + 1])
    moved, rays = np.empty((len(points), 3)), np.empty((len(points), 3))
    for p in range(len(points)):
        k = knot[p]
        place_point(points[p], k, share[p], knots, turns, moved[p], rays[p])
    return moved, rays


@compiled
def place_point(point: Floats, k: int, share: float, knots: Floats, turns: Floats, moved: Floats, ray: Floats) -> None:
    """Fills in a point's place (3,) and its unit ray (3,) in `odom`; as in `placed`, with the rotation vectors `turns`
    (K, 3) between the knots."""
    T = knots[k]
    x = T[0, 0] * point[0] + T[0, 1] * point[1] + T[0, 2] * point[2]
    y = T[1, 0] * point[0] + T[1, 1] * point[1] + T[1, 2] * point[2]
    z = T[2, 0] * point[0] + T[2, 1] * point[1] + T[2, 2] * point[2]
    if share != 0.0:
        x, y, z = rotated_by(turns[k], share, x, y, z)
    far = 1 / math.sqrt(x * x + y * y + z * z)
    ray[0], ray[1], ray[2] = x * far, y * far, z * far
    for i in range(3):
        moved[i] = T[i, 3]
        if share != 0.0:
            moved[i] += share * (knots[k + 1, i, 3] - T[i, 3])
    moved[0] += x
    moved[1] += y
    moved[2] += z
