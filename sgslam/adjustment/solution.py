"""The joint adjustment: errors of the keyframes' poses in plan view, and the walls' offsets from the plan.

Most walls stand as planned, some far from it: offsets have a Laplace distribution, whose optimum is the least sum of
absolute values (iteratively reweighted least squares). A moved wall then pulls no more than one that is off by
millimetres, and, unlike with redescending losses, there is one optimum.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix, diags, vstack
from scipy.sparse.linalg import splu

from sgslam.adjustment.wall_points import Faces, WallPoints
from sgslam.config.sensor import RANGE_NOISE

Floats = NDArray[np.float64]
_BEGIN = 0.02, 0.002  # m and rad, standard deviations of the first pose's error, and after a gap
_SMOOTH = 0.001  # m, below which an offset counts as its square
_ROUNDS = 30  # of reweighting; the poses then change by less than 0.1 mm


@dataclass(frozen=True, eq=False)
class Steps:
    """The odometry's motion to each of K keyframes from the one before it, in plan view: `shift` (K, 2) in metres, its
    standard deviation `sigma` (K,) and that of the turn `sigma_turn` (K,) in rad; infinite where there is none."""

    shift: Floats
    sigma: Floats
    sigma_turn: Floats


def pose_errors(
    faces: Faces, seen: WallPoints, steps: Steps, sigma_built: float, sigma_shared: float
) -> Floats:  # fmt: skip
    """(K, 3) the likeliest errors of the keyframes in x, y (m) and heading (rad), in the plan's frame.

    `sigma_built` (m) is the standard deviation of a wall's offset, `sigma_shared` (m) that of the error that all points
    of a wall in one keyframe share.
    """
    count, walls = len(steps.sigma), int(faces.wall.max(initial=-1)) + 1
    jacobian, measured = _system(faces, seen, steps, walls, sigma_shared)
    information, right = (jacobian.T @ jacobian).tocsc(), jacobian.T @ measured
    weight = np.full(walls, sigma_built**-2)
    solution = np.zeros(walls + 3 * count)
    for _ in range(_ROUNDS):
        prior = diags(np.concatenate([weight, np.zeros(3 * count)]))
        solution = splu((information + prior).tocsc()).solve(right)
        weight = np.sqrt(2.0) / (sigma_built * np.maximum(np.abs(solution[:walls]), _SMOOTH))
    return np.asarray(solution[walls:].reshape(-1, 3))


def _system(
    faces: Faces, seen: WallPoints, steps: Steps, walls: int, sigma_shared: float
) -> tuple[csc_matrix, Floats]:  # fmt: skip
    """The whitened Jacobian of walls and errors, and the measurements: points of faces, then steps."""
    of_points, measured = _of_points(faces, seen, walls, len(steps.sigma), sigma_shared)
    of_steps = _of_steps(steps, walls)
    residual = np.concatenate([measured, np.zeros(of_steps.shape[0])])
    return csc_matrix(vstack([of_points, of_steps])), residual


def _of_points(
    faces: Faces, seen: WallPoints, walls: int, keyframes: int, sigma_shared: float
) -> tuple[csc_matrix, Floats]:  # fmt: skip
    """A row for each mean of points: the wall's offset, and the keyframe's error where the points are."""
    count, n, lever = len(seen.face), seen.normal, seen.lever
    sigma = np.hypot(RANGE_NOISE / np.sqrt(seen.count), sigma_shared)
    turned = n[:, 1] * lever[:, 0] - n[:, 0] * lever[:, 1]
    entries = np.column_stack([faces.sign[seen.face], n, turned]) / sigma[:, None]
    first = walls + 3 * seen.keyframe
    columns = np.column_stack([faces.wall[seen.face], first, first + 1, first + 2])
    rows = np.repeat(np.arange(count), 4)
    jacobian = csc_matrix((entries.ravel(), (rows, columns.ravel())), (count, walls + 3 * keyframes))
    return jacobian, seen.offset / sigma


def _of_steps(steps: Steps, walls: int) -> csc_matrix:
    """Three rows for each keyframe: its error is that of the one before, which its turn carries along the step."""
    count = len(steps.sigma)
    known = np.isfinite(steps.sigma)
    sigma = np.where(known, steps.sigma, _BEGIN[0]), np.where(known, steps.sigma_turn, _BEGIN[1])
    weight = 1 / np.column_stack([sigma[0], sigma[0], sigma[1]])
    own = walls + np.arange(3 * count)
    row, after = np.arange(3 * count), np.repeat(known, 3)
    carried = np.column_stack([steps.shift[:, 1], -steps.shift[:, 0]]) * weight[:, :2]
    by_turn = np.repeat(own.reshape(-1, 3)[:, 2] - 3, 2)
    turned = row.reshape(-1, 3)[:, :2].ravel()
    moved = np.repeat(known, 2)
    rows = np.concatenate([row, row[after], turned[moved]])
    columns = np.concatenate([own, own[after] - 3, by_turn[moved]])
    entries = np.concatenate([weight.ravel(), -weight.ravel()[after], carried.ravel()[moved]])
    return csc_matrix((entries, (rows, columns)), (3 * count, walls + 3 * count))
