"""Walls that a keyframe saw askew: a few points through a door, or of a door that stands ajar, taken for the wall."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sgslam.mapping.wall_map import SeenWall

MIN_TURN, SIGMAS = 0.052, 3.0  # rad, and sigmas, from how most keyframes saw the wall turned
MAX_SHARE = 0.1  # of all sights; where more seem askew, it is the map that has drifted


def wall_outliers(seen: Sequence[SeenWall], rotations: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(N,) which of the sights show their wall turned otherwise than most sights of it do, by more than three degrees
    and what they may be wrong by.

    `rotations` (K, 3, 3), map from sensor, of the keyframes. What all that a keyframe saw is turned by is the
    keyframe's own error, and tells nothing of a sight; nor do several sights of one keyframe that are turned: then it
    is the keyframe, or the map, that came round turned.
    """
    if not seen:
        return np.zeros(0, dtype=bool)
    told = np.array([(s.keyframe, s.wall, s.sigma_normal, *s.plane[:3]) for s in seen])
    keyframe, wall = told[:, 0].astype(np.int64), told[:, 1].astype(np.int64)
    normal = np.einsum("nij,nj->ni", rotations[keyframe, :2], told[:, 3:])
    middle = np.stack([_median(wall, normal[:, k]) for k in (0, 1)], axis=-1)
    turned = np.arctan2(
        middle[:, 0] * normal[:, 1] - middle[:, 1] * normal[:, 0], np.einsum("nk,nk->n", middle, normal)
    )
    found = np.abs(turned - _median(keyframe, turned)) > MIN_TURN + SIGMAS * told[:, 2]
    alone = np.bincount(keyframe, found)[keyframe] == 1
    return np.asarray(found & alone & (found.mean() < MAX_SHARE))


def _median(of: NDArray[np.int64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """(N,) the median of the values (N,) of the same thing, the lower one of the middle two."""
    order = np.lexsort((values, of))
    first = np.flatnonzero(np.diff(of[order], prepend=-1))
    count = np.diff(first, append=len(of))
    found = np.empty(len(values))
    found[order] = np.repeat(values[order][first + (count - 1) // 2], count)
    return found
