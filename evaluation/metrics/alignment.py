"""Alignments of a trajectory to the truth, as the literature on trajectory errors names them."""

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from sgslam.geometry.frames import inverse
from sgslam.report.accuracy import STANDING_M, STRAIGHT_RATIO, align_se3

Array = NDArray[np.float64]
Alignment = Literal["none", "se3", "yaw", "origin"]


def align(estimate: Array, truth: Array, alignment: Alignment) -> Array:
    """The motion (4, 4) T_truth_estimate that is applied to the estimate before its errors are taken.

    `estimate` and `truth` are (M, 4, 4) poses of the same instants, M >= 1. `none`: the identity. `se3`: least
    squares over the positions (Umeyama, PAMI 1991), without scale. `yaw`: the same with 4 degrees of freedom, for
    estimates whose z is known to be up. `origin`: the first poses coincide.

    Raises UserError where the motion of the poses does not determine the alignment, and for an unknown one.
    """
    if alignment == "none":
        return np.eye(4)
    if alignment == "se3":
        return align_se3(estimate[:, :3, 3], truth[:, :3, 3])
    if alignment == "yaw":
        return align_yaw(estimate[:, :3, 3], truth[:, :3, 3])
    if alignment == "origin":
        return truth[0] @ inverse(estimate[0])
    raise UserError(f"no alignment '{alignment}'; there are {', '.join(get_args(Alignment))}")


def align_yaw(points: Array, targets: Array) -> Array:
    """The turn about z and the shift (4, 4) that take `points` (N, 3) onto `targets` (N, 3) with least squares error.

    Zhang and Scaramuzza, "A tutorial on quantitative trajectory evaluation for visual(-inertial) odometry", IROS 2018.
    A straight drive is enough for it. Raises UserError where the points do not move in plan, or where the two
    motions have no turn in common.
    """
    centre_p, centre_t = points.mean(axis=0), targets.mean(axis=0)
    p, t = (points - centre_p)[:, :2], (targets - centre_t)[:, :2]
    spread = min(np.sqrt((p**2).sum(axis=1).mean()), np.sqrt((t**2).sum(axis=1).mean()))
    if len(points) < 2 or spread < STANDING_M:
        raise UserError(f"{len(points)} matched poses spread over {spread:.3f} m in plan: too little motion to align")
    along, across = float((p * t).sum()), float((p[:, 0] * t[:, 1] - p[:, 1] * t[:, 0]).sum())
    if np.hypot(along, across) < STRAIGHT_RATIO * np.sqrt((p**2).sum() * (t**2).sum()):
        raise UserError("the trajectory and the truth have no turn in common: their alignment is not determined")
    yaw = np.arctan2(across, along)
    T_target_point = np.eye(4)
    T_target_point[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    T_target_point[:3, 3] = centre_t - T_target_point[:3, :3] @ centre_p
    return T_target_point
