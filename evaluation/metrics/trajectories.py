"""Trajectory errors: absolute. Pure functions: no files, no plots.

Poses are paired by time (`sgslam.geometry.trajectory_errors.associate`). Results that evo (https://github.com/MichaelGrupp/evo)
also computes have the same values.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from data.common.errors import UserError
from data.trajectory import Trajectory
from evaluation.metrics.statistics import Statistics
from sgslam.geometry.frames import inverse
from sgslam.geometry.trajectory_errors import TOLERANCE_NS, align_se3, associate, yaw_errors

Array = NDArray[np.float64]
PARTS = "plan_view", "height", "yaw"
_OF_TWO, _OF_ONE = 5.991, 3.841  # 95 % quantiles of chi-squared with two degrees of freedom and with one
WRONG = 0.5, np.radians(5)  # m and rad: beyond, a pose in the BIM frame is at a wrong place


@dataclass(frozen=True, eq=False)
class Matched:
    """Poses (M, 4, 4) of the same instants, M >= 1; `indices` (M,) are those of the estimate."""

    estimate: Array
    truth: Array
    stamps_ns: NDArray[np.int64]
    indices: NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Ape:
    """Absolute pose error: `translation_m` (M,), by matched pose, after the alignment `T_truth_estimate` (4, 4)."""

    T_truth_estimate: Array
    translation_m: Array
    translation: Statistics


@dataclass(frozen=True)
class ErrorInBim:
    """Errors in the BIM frame, without alignment: metres for `position` (3D), `horizontal`, `height`; radians for `yaw`
    (about the plan's z)."""

    position: Statistics
    horizontal: Statistics
    height: Statistics
    yaw: Statistics
    matched_poses: int


def matched(estimate: Trajectory, truth: Trajectory) -> Matched:
    """Pairs the poses by time. Raises UserError if there is no pair."""
    ours, true = associate(estimate.stamps_ns, truth.stamps_ns)
    if not len(ours):
        apart = f"{len(estimate)} poses and {len(truth)} true poses"
        raise UserError(f"{apart}: none within {TOLERANCE_NS / 1e9:g} s of each other; their clocks must be the same")
    return Matched(estimate.poses[ours], truth.poses[true], estimate.stamps_ns[ours], ours)


def origin_alignment(estimate: Trajectory, truth: Trajectory) -> Array:
    """(4, 4) the pose of the estimate's frame in the truth's by which the first poses of the same instant coincide.

    Raises UserError where no pose matches.
    """
    both = matched(estimate, truth)
    return np.asarray(both.truth[0] @ inverse(both.estimate[0]))


def ape(estimate: Trajectory, truth: Trajectory, alignment: Literal["se3", "origin"]) -> Ape:
    """The absolute pose error (Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012).

    Alignment `se3`: least squares over the positions (Umeyama, PAMI 1991), without scale. `origin`: the first poses
    coincide. Raises UserError where no pose matches or the motion does not determine the alignment.
    """
    both = matched(estimate, truth)
    if alignment == "se3":
        T_truth_estimate = align_se3(both.estimate[:, :3, 3], both.truth[:, :3, 3])
    else:
        T_truth_estimate = origin_alignment(estimate, truth)
    translation = np.linalg.norm((T_truth_estimate @ both.estimate)[:, :3, 3] - both.truth[:, :3, 3], axis=1)
    return Ape(T_truth_estimate, translation, Statistics.of(translation))


def error_in_bim(estimate_in_bim: Trajectory, truth_in_bim: Trajectory) -> ErrorInBim:
    """The errors of an anchored trajectory as they are. Raises UserError where no pose matches."""
    both = matched(estimate_in_bim, truth_in_bim)
    offset = both.estimate[:, :3, 3] - both.truth[:, :3, 3]
    return ErrorInBim(
        Statistics.of(np.linalg.norm(offset, axis=1)),
        Statistics.of(np.linalg.norm(offset[:, :2], axis=1)),
        Statistics.of(offset[:, 2]),
        Statistics.of(yaw_errors(both.estimate, both.truth)),
        len(offset),
    )


def wrong_poses(estimate_in_bim: Trajectory, truth_in_bim: Trajectory) -> int:
    """How many poses are off by more than `WRONG`, in space or in attitude; the truth is interpolated."""
    if not len(estimate_in_bim):
        return 0
    off = inverse(truth_in_bim.at(estimate_in_bim.stamps_ns)) @ estimate_in_bim.poses
    turned = np.arccos(np.clip((np.trace(off[:, :3, :3], axis1=1, axis2=2) - 1) / 2, -1.0, 1.0))
    return int(((np.linalg.norm(off[:, :3, 3], axis=1) > WRONG[0]) | (turned > WRONG[1])).sum())


class Inside(BaseModel):
    """The shares of `poses` poses whose errors in plan view, in height and in yaw lie inside their 95 % regions."""

    model_config = ConfigDict(frozen=True)

    poses: int
    plan_view: float
    height: float
    yaw: float


def inside_95(estimate: Trajectory, truth: Trajectory, sigma: Array) -> Inside | None:
    """The shares for the poses whose standard deviations `sigma` (N, 6) are known: along x, y, z (m) and about x, y, z
    (rad) of the frame of both trajectories. None where none is. Raises UserError for sigmas of another shape.

    Errors along x and y are taken as independent.
    """
    if sigma.shape != (len(estimate), 6):
        raise UserError(f"sigmas of shape {sigma.shape} for {len(estimate)} poses; give (N, 6)")
    known = np.isfinite(sigma).all(axis=1)
    if not known.any():
        return None
    true, sigma = truth.at(estimate.stamps_ns[known]), sigma[known]
    off = (estimate.poses[known] - true)[:, :3, 3] / sigma[:, :3]
    yaw = yaw_errors(estimate.poses[known], true) / sigma[:, 5]
    return Inside(
        poses=int(known.sum()),
        plan_view=float(((off[:, :2] ** 2).sum(axis=1) < _OF_TWO).mean()),
        height=float((off[:, 2] ** 2 < _OF_ONE).mean()),
        yaw=float((yaw**2 < _OF_ONE).mean()),
    )
