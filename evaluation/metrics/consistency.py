"""Whether stated uncertainties hold: how often errors lie inside
their 95 % regions."""

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from data.common.errors import UserError
from data.trajectory import Trajectory
from sgslam.report.accuracy import yaw_errors

Array = NDArray[np.float64]
DOF = 6
PARTS = "plan_view", "height", "yaw"
_OF_TWO, _OF_ONE = 5.991, 3.841  # 95 % quantiles of chi-squared with two degrees of freedom and with one


def normalised_squared(error: Array, covariance: Array, pose: int) -> float:
    """The squared Mahalanobis distance of an error (6,) by its covariance (6, 6). Raises UserError with the number of
    the `pose` for a covariance that is not finite, symmetric and positive definite."""
    scale = np.abs(covariance).max()
    if not np.isfinite(scale) or np.abs(covariance - covariance.T).max() > 1e-6 * scale:
        raise UserError(f"the covariance of pose {pose} is not finite and symmetric")
    try:
        whitened = np.linalg.solve(np.linalg.cholesky((covariance + covariance.T) / 2), error)
    except np.linalg.LinAlgError:
        raise UserError(f"the covariance of pose {pose} is not positive definite") from None
    return float(whitened @ whitened)


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
        poses=int(known.sum()), plan_view=float(((off[:, :2] ** 2).sum(axis=1) < _OF_TWO).mean()),
        height=float((off[:, 2] ** 2 < _OF_ONE).mean()), yaw=float((yaw**2 < _OF_ONE).mean()),
    )  # fmt: skip
