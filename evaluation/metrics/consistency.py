"""Consistency of an estimate's covariances with its errors: the normalised estimation error squared (NEES)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.trajectory import Trajectory
from evaluation.metrics.trajectories import matched
from sgslam.geometry.frames import local_coordinates
from sgslam.report.accuracy import TOLERANCE_NS

Array = NDArray[np.float64]
DOF = 6


@dataclass(frozen=True, eq=False)
class Nees:
    """The NEES of a trajectory.

    `per_pose` (M,) is e^T P^-1 e; `mean_per_dof` is its mean over 6, one for correct covariances. `bounds_per_dof` is
    the mean's 95 % interval for independent errors; `share_within` is the share of poses below the 95 % bound of one
    pose.
    """

    per_pose: Array
    mean_per_dof: float
    bounds_per_dof: tuple[float, float]
    share_within: float
    matched_poses: int
    total_poses: int

    @property
    def verdict(self) -> str:
        """`overconfident` above the bounds, `underconfident` below, else `consistent`."""
        low, high = self.bounds_per_dof
        return "overconfident" if self.mean_per_dof > high else (
            "underconfident" if self.mean_per_dof < low else "consistent"
        )  # fmt: skip


def nees(estimate: Trajectory, truth: Trajectory, covariances: Array, tolerance_ns: int = TOLERANCE_NS) -> Nees:
    """The normalised estimation error squared (Bar-Shalom, Li, Kirubarajan 2001, 5.4), without alignment.

    `covariances` (N, 6, 6), one for each pose of the estimate, as GTSAM's marginals: rotation (rad) first, then
    translation (m), in the pose's own axes, T_true = T_estimate Exp(e). The errors of a trajectory are correlated in
    time, so the mean scatters more than the bounds suggest. Raises UserError if no pose matches or a covariance is not
    symmetric and positive definite.
    """
    covariances = np.asarray(covariances, dtype=float)
    if covariances.shape != (len(estimate), DOF, DOF):
        raise UserError(f"NEES: covariances of shape {covariances.shape} for {len(estimate)} poses; give (N, 6, 6)")
    both = matched(estimate, truth, tolerance_ns)
    errors = np.array([
        local_coordinates(ours, true)
        for ours, true in zip(both.estimate, both.truth, strict=True)
    ])  # fmt: skip
    squared = [
        _squared(error, covariances[k], k) for error, k in zip(errors, both.indices.tolist(), strict=True)
    ]  # fmt: skip
    return _summary(np.array(squared), both.total)


def _summary(per_pose: Array, total: int) -> Nees:
    from scipy.stats import chi2

    count = len(per_pose)
    low, high = chi2.ppf([0.025, 0.975], DOF * count) / (DOF * count)
    within = float(np.mean(per_pose <= chi2.ppf(0.95, DOF)))
    return Nees(per_pose, float(per_pose.mean() / DOF), (float(low), float(high)), within, count, total)


def _squared(error: Array, covariance: Array, pose: int) -> float:
    scale = np.abs(covariance).max()
    if not np.isfinite(scale) or np.abs(covariance - covariance.T).max() > 1e-6 * scale:
        raise UserError(f"NEES: the covariance of pose {pose} is not finite and symmetric")
    try:
        whitened = np.linalg.solve(np.linalg.cholesky((covariance + covariance.T) / 2), error)
    except np.linalg.LinAlgError:
        raise UserError(f"NEES: the covariance of pose {pose} is not positive definite") from None
    return float(whitened @ whitened)
