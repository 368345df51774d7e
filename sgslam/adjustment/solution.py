"""The joint adjustment: errors of the keyframes' poses in plan view, and the walls' offsets from the plan.

Most walls stand as planned, some far from it: offsets have a Laplace distribution, whose optimum is the least sum of
absolute values (iteratively reweighted least squares). A moved wall then pulls no more than one that is off by
millimetres, and, unlike with redescending losses, there is one optimum.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix, diags
from scipy.sparse.linalg import splu

from sgslam.adjustment.wall_points import SIGMA_RANGE, Faces, WallPoints

Floats = NDArray[np.float64]
_BEGIN = 0.02, 0.002  # m and rad, standard deviations of the first pose's error, and after a gap
_SMOOTH = 0.001  # m, below which an offset counts as its square
_STEPS = 30


@dataclass(frozen=True, eq=False)
class Steps:
    """The odometry's motion to each of K keyframes from the one before it, in plan view: `shift` (K, 2) in metres, its
    standard deviation `sigma` (K,) and that of the turn `sigma_turn` (K,) in rad; infinite where there is none."""

    shift: Floats
    sigma: Floats
    sigma_turn: Floats


@dataclass(frozen=True, eq=False)
class Adjusted:
    """`error` (K, 3) of the keyframes' x, y (m) and heading (rad); `offset` (W,) of the walls, each in the sense of its first face's normal."""

    error: Floats
    offset: Floats


def adjusted(
    faces: Faces, seen: WallPoints, steps: Steps, sigma_built: float, sigma_shared: float
) -> Adjusted:  # fmt: skip
    """The likeliest errors and offsets.

    `sigma_built` (m) is the standard deviation of a wall's offset, `sigma_shared` (m) that of the error that all points
    of a wall in one keyframe share.
    """
    count, walls = len(steps.sigma), int(faces.wall.max(initial=-1)) + 1
    jacobian, residual = _system(faces, seen, steps, walls, sigma_shared)
    information, right = (jacobian.T @ jacobian).tocsc(), jacobian.T @ residual
    weight = np.full(walls, sigma_built**-2)
    solution = np.zeros(walls + 3 * count)
    for _ in range(_STEPS):
        prior = diags(np.concatenate([weight, np.zeros(3 * count)]))
        solution = splu((information + prior).tocsc()).solve(right)
        weight = np.sqrt(2.0) / (sigma_built * np.maximum(np.abs(solution[:walls]), _SMOOTH))
    return Adjusted(solution[walls:].reshape(-1, 3), solution[:walls])


def _system(
    faces: Faces, seen: WallPoints, steps: Steps, walls: int, sigma_shared: float
) -> tuple[csc_matrix, Floats]:  # fmt: skip
    """The whitened Jacobian and the measurements: points of walls, then steps."""
    count, n, lever = len(steps.sigma), seen.normal, seen.lever
    sigma = np.hypot(SIGMA_RANGE / np.sqrt(seen.count), sigma_shared)
    row, at = np.arange(len(sigma)), walls + 3 * seen.keyframe
    turned = n[:, 1] * lever[:, 0] - n[:, 0] * lever[:, 1]  # of a point under a turn, along the normal
    rows = [np.tile(row, 4)]
    columns = [np.concatenate([faces.wall[seen.face], at, at + 1, at + 2])]
    entries = [np.concatenate([faces.sign[seen.face], n[:, 0], n[:, 1], turned]) / np.tile(sigma, 4)]
    first = len(row)
    for k in range(count):
        to, before = walls + 3 * k, walls + 3 * (k - 1)
        known = k > 0 and np.isfinite(steps.sigma[k])
        weights = 1 / np.array([steps.sigma[k], steps.sigma[k], steps.sigma_turn[k]] if known else [*_BEGIN[:1] * 2, _BEGIN[1]])
        rows.append(first + np.arange(3))
        columns.append(to + np.arange(3))
        entries.append(weights)
        if known:
            x, y = steps.shift[k]
            rows += [first + np.arange(3), first + np.arange(2)]
            columns += [before + np.arange(3), np.full(2, before + 2)]
            entries += [-weights, weights[:2] * [y, -x]]
        first += 3
    shape = (first, walls + 3 * count)
    jacobian = csc_matrix((np.concatenate(entries), (np.concatenate(rows), np.concatenate(columns))), shape=shape)
    return jacobian, np.concatenate([seen.offset / sigma, np.zeros(3 * count)])
