"""Wall outliers: observations at a wrong angle, such as points seen through a door or on a door ajar."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sgslam.mapping import SeenWall

MIN_TURN, SIGMAS = 0.052, 3.0  # rad, and sigmas, from the median normal of the wall's observations
MAX_SHARE = 0.1  # of all observations; if more seem to be outliers, the map itself has drifted


def wall_outliers(seen: Sequence[SeenWall], rotations: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N,) flags of observations whose normal differs from the median of their wall by over three degrees plus noise.

    `rotations` (K, 3, 3) are R_map_sensor of the keyframes. A rotation common to all observations of a keyframe is the
    keyframe's own error and is subtracted. Several outliers in one keyframe do not count: then the keyframe, or the
    map, is rotated.
    """
    if not seen:
        return np.zeros(0, dtype=bool)
    rows = np.array([(s.keyframe, s.wall, s.sigma_normal, *s.plane[:3]) for s in seen])
    keyframe, wall = rows[:, 0].astype(np.int64), rows[:, 1].astype(np.int64)
    normal = np.einsum("nij,nj->ni", rotations[keyframe, :2], rows[:, 3:])
    middle = np.stack([_median(wall, normal[:, k]) for k in (0, 1)], axis=-1)
    turned = np.arctan2(
        middle[:, 0] * normal[:, 1] - middle[:, 1] * normal[:, 0], np.einsum("nk,nk->n", middle, normal)
    )
    found = np.abs(turned - _median(keyframe, turned)) > MIN_TURN + SIGMAS * rows[:, 2]
    alone = np.bincount(keyframe, found)[keyframe] == 1
    return np.asarray(found & alone & (found.mean() < MAX_SHARE))


def _median(of: NDArray[np.int64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) the median of the values (N,) of each group in `of` (N,), the lower one of the middle two."""
    order = np.lexsort((values, of))
    first = np.flatnonzero(np.diff(of[order], prepend=-1))
    count = np.diff(first, append=len(of))
    found = np.empty(len(values))
    found[order] = np.repeat(values[order][first + (count - 1) // 2], count)
    return found
