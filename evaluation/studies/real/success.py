"""Whether a sensor was placed in a building: limits on position and yaw, and pieces of a way of equal length. Pure
functions: no files, no plots."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.trajectory import Trajectory
from sgslam.report import associate
from sgslam.report.accuracy import align_se3, yaw_errors

Array = NDArray[np.float64]
_NEAR_NS = 1_000_000_000  # from a pose, at most, to interpolate the way at a surveyed point


@dataclass(frozen=True)
class Limits:
    """A place is right within so many metres in space and so many radians in yaw."""

    position_m: float
    yaw_rad: float


COARSE = Limits(3.0, float(np.radians(5.0)))
FINE = Limits(0.3, float(np.radians(1.0)))


@dataclass(frozen=True, eq=False)
class PlaceErrors:
    """Errors in the BIM frame of the poses that match a true one in time, in order: `position_m` (M,) in space and
    `yaw_rad` (M,), magnitudes; M may be 0."""

    position_m: Array
    yaw_rad: Array

    def within(self, limits: Limits) -> NDArray[np.bool_]:
        """(M,) which of them are right."""
        return (self.position_m <= limits.position_m) & (self.yaw_rad <= limits.yaw_rad)


def place_errors(estimate_in_bim: Trajectory, truth_in_bim: Trajectory) -> PlaceErrors:
    """The errors of an anchored trajectory, without alignment."""
    ours, true = associate(estimate_in_bim.stamps_ns, truth_in_bim.stamps_ns)
    estimate, truth = estimate_in_bim.poses[ours], truth_in_bim.poses[true]
    return PlaceErrors(
        np.linalg.norm(estimate[:, :3, 3] - truth[:, :3, 3], axis=1), np.abs(yaw_errors(estimate, truth))
    )


def aligned_rmse(estimate: Trajectory, truth: Trajectory, point: Array) -> float | None:
    """The RMSE (m) of a point of the carrier against its true positions, after SE(3) alignment of the estimate.

    `point` (3,) is in the sensor's frame; the estimate is interpolated at the truth's stamps. None where
    fewer than three stamps are near a pose, or the way does not determine the alignment.
    """
    stamps = truth.between(estimate).stamps_ns
    if len(estimate) < 2 or not len(stamps):
        return None
    after = np.clip(np.searchsorted(estimate.stamps_ns, stamps), 1, len(estimate) - 1)
    gap = np.minimum(*(np.abs(estimate.stamps_ns[index] - stamps) for index in (after - 1, after)))
    stamps = stamps[gap <= _NEAR_NS]
    places = estimate.at(stamps) @ np.append(point, 1.0)
    targets = truth.only(np.isin(truth.stamps_ns, stamps)).positions
    try:
        T_truth_estimate = align_se3(places[:, :3], targets)
    except UserError:
        return None
    off = (places @ T_truth_estimate.T)[:, :3] - targets
    return float(np.sqrt((off**2).sum(axis=1).mean()))


def piece_of_each(truth: Trajectory, length_m: float) -> NDArray[np.intp]:
    """(N,) the number of the piece of the path, each of this length, that each true pose is in; -1 in the rest at the
    end that is shorter."""
    steps = np.linalg.norm(np.diff(truth.positions, axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    pieces = (way // length_m).astype(np.intp)
    return np.where(pieces < way[-1] // length_m, pieces, -1)
