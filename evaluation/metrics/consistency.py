"""Consistency of an estimate's covariances with its errors: the normalised estimation error squared (NEES)."""

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.trajectory import Trajectory
from evaluation.metrics.trajectories import matched
from sgslam.geometry.frames import local_coordinates

Array = NDArray[np.float64]
DOF = 6


def nees(estimate: Trajectory, truth: Trajectory, covariances: Array) -> float:
    """The mean normalised estimation error squared per degree of freedom, without alignment: 1 if the covariances are
    right, above if they are overconfident (Bar-Shalom, Li, Kirubarajan 2001, 5.4).

    `covariances` (N, 6, 6), one for each pose of the estimate, as GTSAM's marginals: rotation (rad) first, then
    translation (m), in the pose's own axes, T_true = T_estimate Exp(e). Raises UserError where no pose matches or a
    covariance is not symmetric and positive definite.
    """
    covariances = np.asarray(covariances, dtype=float)
    if covariances.shape != (len(estimate), DOF, DOF):
        raise UserError(f"NEES: covariances of shape {covariances.shape} for {len(estimate)} poses; give (N, 6, 6)")
    both = matched(estimate, truth)
    errors = np.array([
        local_coordinates(ours, true)
        for ours, true in zip(both.estimate, both.truth, strict=True)
    ])  # fmt: skip
    squared = [
        _squared(error, covariances[k], k) for error, k in zip(errors, both.indices.tolist(), strict=True)
    ]  # fmt: skip
    return float(np.mean(squared) / DOF)


def _squared(error: Array, covariance: Array, pose: int) -> float:
    scale = np.abs(covariance).max()
    if not np.isfinite(scale) or np.abs(covariance - covariance.T).max() > 1e-6 * scale:
        raise UserError(f"NEES: the covariance of pose {pose} is not finite and symmetric")
    try:
        whitened = np.linalg.solve(np.linalg.cholesky((covariance + covariance.T) / 2), error)
    except np.linalg.LinAlgError:
        raise UserError(f"NEES: the covariance of pose {pose} is not positive definite") from None
    return float(whitened @ whitened)
