"""Errors of tracking: of the motion over a second, and of single steps. Pure functions: no files, no plots."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.trajectory import Trajectory
from sgslam.geometry.frames import inverse

Array = NDArray[np.float64]
TOLERANCE = 0.05  # of the time between the poses of a pair: half a scan of ten a second


@dataclass(frozen=True, eq=False)
class MotionErrors:
    """Errors of relative motions: `translation_m` and `rotation_rad` (K,) of the pairs of poses `pairs` (K, 2)."""

    pairs: NDArray[np.intp]
    translation_m: Array
    rotation_rad: Array


def errors_over_time(estimate: Trajectory, truth: Trajectory, seconds: float = 1.0) -> MotionErrors:
    """The relative pose error (Sturm et al., IROS 2012) between poses that lie so many seconds apart.

    For each pose of the estimate the first one that lies `seconds` later, give or take a twentieth; there is no
    alignment. The truth is interpolated at the estimate's stamps. Raises UserError if no two poses lie that far apart.
    """
    stamps, delta = estimate.stamps_ns, round(seconds * 1e9)
    slack = round(TOLERANCE * delta)
    second = np.searchsorted(stamps, stamps + (delta - slack))
    inside = second < len(stamps)
    pairs = np.column_stack([np.flatnonzero(inside), second[inside]])
    pairs = pairs[np.diff(stamps[pairs], axis=1)[:, 0] <= delta + slack]
    if not len(pairs):
        raise UserError(f"no two of {len(stamps)} poses lie {seconds:g} s apart; give a longer drive")
    return _errors(estimate, truth, pairs)


def step_errors(estimate: Trajectory, truth: Trajectory) -> MotionErrors:
    """The errors of the motions between neighbouring poses of the estimate; the truth is interpolated at its stamps.

    Raises UserError for less than two poses.
    """
    if len(estimate) < 2:
        raise UserError(f"{len(estimate)} poses: no step between two of them")
    first = np.arange(len(estimate) - 1)
    return _errors(estimate, truth, np.column_stack([first, first + 1]))


def _errors(estimate: Trajectory, truth: Trajectory, pairs: NDArray[np.intp]) -> MotionErrors:
    first, second = pairs.T
    true = truth.at(estimate.stamps_ns)
    error = inverse(inverse(true[first]) @ true[second]) @ inverse(estimate.poses[first]) @ estimate.poses[second]
    return MotionErrors(pairs, np.linalg.norm(error[:, :3, 3], axis=1), _angles(error[:, :3, :3]))


def _angles(R: Array) -> Array:
    """(N,) the angles (rad) of rotations (N, 3, 3), exact for small ones too."""
    twice_sine = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1)
    return np.arctan2(np.linalg.norm(twice_sine, axis=1), np.trace(R, axis1=1, axis2=2) - 1)
