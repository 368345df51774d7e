"""Whether the standard deviations of poses are true: how often errors lie inside their 95 % regions."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from data.common.errors import UserError
from data.trajectory import Trajectory
from sgslam.report.accuracy import yaw_errors
from sgslam.session import Result

Array = NDArray[np.float64]
PARTS = "plan_view", "height", "yaw"
_OF_TWO, _OF_ONE = 5.991, 3.841  # 95 % quantiles of chi-squared with two degrees of freedom and with one


class Inside(BaseModel):
    """The shares of `poses` poses whose errors in plan view, in height and in yaw lie inside their 95 % regions."""

    model_config = ConfigDict(frozen=True)

    poses: int
    plan_view: float
    height: float
    yaw: float


def inside(result: Result, truth: Trajectory) -> Inside | None:
    """The shares for the poses of a run's `trajectory`, in the frame of the truth. None where none is known."""
    told = result.uncertainty
    return inside_95(result.trajectory, truth, told.sigma[np.isin(told.stamps_ns, result.trajectory.stamps_ns)])


def pooled(rows: pd.DataFrame) -> dict[str, str]:
    """The shares of all poses of these runs as cells of a table; their columns `inside.*` are those of `Inside`."""
    poses = rows["inside.poses"].astype(float)
    shares = {name: rows[f"inside.{name}"].astype(float) @ poses / poses.sum() for name in PARTS}
    return {"poses": f"{poses.sum():.0f}", **{name.replace("_", " "): f"{share:.1%}" for name, share in shares.items()}}


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
