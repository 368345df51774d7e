"""Places of points that were measured by a moving sensor."""

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from sgslam.geometry.rotations import rotated_by, turn_between

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@compiled
def placed(points: Floats, knot: Ints, share: Floats, knots: Floats) -> Floats:
    """Points (N, 3) in `odom`.

    Each point was measured by a sensor that had moved a `share` of the way from knot to next knot; `knots` (K, 4, 4)
    are its poses there.
    """
    turns, moved, sensor = turns_between(knots), np.empty((len(points), 3)), np.empty(3)
    for p in range(len(points)):
        place_point(points, p, knot[p], share[p], knots, turns, moved, sensor)
    return moved


@compiled
def turns_between(knots: Floats) -> Floats:
    """(K, 3) the rotation vectors from each of the poses (K, 4, 4) to the next one."""
    turns = np.zeros((len(knots), 3))
    for k in range(len(knots) - 1):
        turns[k] = turn_between(knots[k], knots[k + 1])
    return turns


@compiled
def place_point(
    points: Floats, p: int, k: int, share: float, knots: Floats, turns: Floats, moved: Floats, sensor: Floats
) -> None:
    """Fills in where point `p`, moved[p], and the sensor (3,) that measured it were in `odom`; as in `placed`, with the
    rotation vectors `turns` (K, 3) between the knots."""
    px, py, pz = points[p, 0], points[p, 1], points[p, 2]
    x = knots[k, 0, 0] * px + knots[k, 0, 1] * py + knots[k, 0, 2] * pz
    y = knots[k, 1, 0] * px + knots[k, 1, 1] * py + knots[k, 1, 2] * pz
    z = knots[k, 2, 0] * px + knots[k, 2, 1] * py + knots[k, 2, 2] * pz
    for i in range(3):
        sensor[i] = knots[k, i, 3]
    if share != 0.0:
        x, y, z = rotated_by(share * turns[k, 0], share * turns[k, 1], share * turns[k, 2], x, y, z)
        for i in range(3):
            sensor[i] += share * (knots[k + 1, i, 3] - knots[k, i, 3])
    moved[p, 0], moved[p, 1], moved[p, 2] = x + sensor[0], y + sensor[1], z + sensor[2]
