"""Trajectory errors: absolute, relative and drift. Pure functions: no files, no plots.

Poses are paired by time (`sgslam.report.accuracy.associate`); every result has the number of paired poses. Translation
errors are in metres, rotation errors are angles in radians. Results that evo (https://github.com/MichaelGrupp/evo) also
computes have the same values.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from data.common.errors import UserError
from data.trajectory import Trajectory
from evaluation.metrics.alignment import Alignment, align
from evaluation.metrics.statistics import Statistics
from sgslam.geometry.frames import inverse
from sgslam.report import associate
from sgslam.report.accuracy import TOLERANCE_NS, yaw_errors

Array = NDArray[np.float64]
SUB_LENGTHS_M = (10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0)  # a tenth of KITTI's, for buildings


@dataclass(frozen=True, eq=False)
class Matched:
    """Poses (M, 4, 4) of the same instants, M >= 1; `indices` (M,) are those of the estimate, `total` its poses."""

    estimate: Array
    truth: Array
    stamps_ns: NDArray[np.int64]
    indices: NDArray[np.intp]
    total: int


@dataclass(frozen=True, eq=False)
class Ape:
    """Absolute pose error. `translation_m` and `rotation_rad` are (M,), by matched pose."""

    alignment: Alignment
    T_truth_estimate: Array
    stamps_ns: NDArray[np.int64]
    translation_m: Array
    rotation_rad: Array
    translation: Statistics
    rotation: Statistics
    matched_poses: int
    total_poses: int


@dataclass(frozen=True)
class ErrorInBim:
    """Errors in the BIM frame, without alignment: metres for `position` (3D), `horizontal`, `height`; radians for
    `rotation` (3D) and `yaw` (about the plan's z)."""

    position: Statistics
    horizontal: Statistics
    height: Statistics
    rotation: Statistics
    yaw: Statistics
    matched_poses: int
    total_poses: int


@dataclass(frozen=True, eq=False)
class Rpe:
    """Relative pose error. `pairs` (K, 2) index the matched poses; `translation_m`, `rotation_rad` are (K,)."""

    delta_m: float
    pairs: NDArray[np.intp]
    translation_m: Array
    rotation_rad: Array
    translation: Statistics
    rotation: Statistics
    matched_poses: int
    total_poses: int


@dataclass(frozen=True)
class Drift:
    """`end_percent`: the last pose's position error over the length travelled, first poses made to coincide.

    `mean_percent` is the mean over all sub-trajectories; None where the run is shorter than the shortest length.
    """

    travelled_m: float
    end_percent: float
    mean_percent: float | None
    matched_poses: int
    total_poses: int


def matched(estimate: Trajectory, truth: Trajectory, tolerance_ns: int = TOLERANCE_NS) -> Matched:
    """Pairs the poses by time. Raises UserError if there is no pair."""
    ours, true = associate(estimate.stamps_ns, truth.stamps_ns, tolerance_ns)
    if not len(ours):
        apart = f"{len(estimate)} poses and {len(truth)} true poses"
        raise UserError(f"{apart}: none within {tolerance_ns / 1e9:g} s of each other; their clocks must be the same")
    return Matched(estimate.poses[ours], truth.poses[true], estimate.stamps_ns[ours], ours, len(estimate))


def ape(
    estimate: Trajectory, truth: Trajectory, alignment: Alignment = "none", tolerance_ns: int = TOLERANCE_NS
) -> Ape:
    """The absolute pose error after an alignment (see `evaluation.metrics.alignment.align`).

    Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012. The rotation error is the angle
    of R_truth^T R_estimate. Raises UserError where no pose matches or the alignment is not determined.
    """
    both = matched(estimate, truth, tolerance_ns)
    T_truth_estimate = align(both.estimate, both.truth, alignment)
    aligned = T_truth_estimate @ both.estimate
    translation = np.linalg.norm(aligned[:, :3, 3] - both.truth[:, :3, 3], axis=1)
    rotation = _angles(inverse(both.truth) @ aligned)
    return Ape(
        alignment, T_truth_estimate, both.stamps_ns, translation, rotation, Statistics.of(translation),
        Statistics.of(rotation), len(translation), both.total,
    )  # fmt: skip


def error_in_bim(estimate_in_bim: Trajectory, truth_in_bim: Trajectory, tolerance_ns: int = TOLERANCE_NS) -> ErrorInBim:
    """The errors of an anchored trajectory as they are. Raises UserError where no pose matches."""
    both = matched(estimate_in_bim, truth_in_bim, tolerance_ns)
    offset = both.estimate[:, :3, 3] - both.truth[:, :3, 3]
    return ErrorInBim(
        Statistics.of(np.linalg.norm(offset, axis=1)), Statistics.of(np.linalg.norm(offset[:, :2], axis=1)),
        Statistics.of(offset[:, 2]), Statistics.of(_angles(inverse(both.truth) @ both.estimate)),
        Statistics.of(yaw_errors(both.estimate, both.truth)), len(offset), both.total,
    )  # fmt: skip


def rpe(
    estimate: Trajectory, truth: Trajectory, delta_m: float = 1.0, *,
    pairs_from: Literal["truth", "estimate"] = "truth", relative_tolerance: float = 0.1,
    tolerance_ns: int = TOLERANCE_NS,
) -> Rpe:  # fmt: skip
    """The relative pose error between poses that lie `delta_m` of travelled way apart; needs no alignment.

    Sturm et al., IROS 2012; E = (Q_i^-1 Q_j)^-1 (P_i^-1 P_j). All pairs, as evo takes them: for each pose the one
    whose path length from it is nearest to `delta_m`, if within `relative_tolerance` of it. The path length is measured
    along the truth, so that all estimates use the same pairs; evo measures along the estimate by default. Raises
    UserError for a length that is not positive and if no two poses lie that far apart.
    """
    if not (np.isfinite(delta_m) and delta_m > 0 and relative_tolerance >= 0):
        raise UserError(f"RPE over {delta_m:g} m: give a positive length and a tolerance of 0 or more")
    both = matched(estimate, truth, tolerance_ns)
    way = _way(both.truth if pairs_from == "truth" else both.estimate)
    pairs = _pairs(way, delta_m, delta_m * relative_tolerance)
    if not len(pairs):
        raise UserError(f"no two poses lie {delta_m:g} m apart on a way of {way[-1]:.3g} m; give another length")
    error = _relative_errors(both, pairs)
    translation, rotation = np.linalg.norm(error[:, :3, 3], axis=1), _angles(error)
    return Rpe(
        delta_m, pairs, translation, rotation, Statistics.of(translation), Statistics.of(rotation), len(way),
        both.total,
    )  # fmt: skip


def drift(
    estimate: Trajectory, truth: Trajectory, lengths_m: Sequence[float] = SUB_LENGTHS_M,
    tolerance_ns: int = TOLERANCE_NS,
) -> Drift:  # fmt: skip
    """The drift in percent of the way travelled (measured along the matched true poses).

    Sub-trajectories as in KITTI (Geiger et al., CVPR 2012, `evaluate_odometry.cpp`): from each pose to the first one
    that lies more than the length further on; the error of the relative pose over the length; the mean over all
    sub-trajectories of all lengths. Starts are all matched poses, where KITTI takes each tenth.

    Raises UserError where no pose matches, the truth stands still, or a length is not positive.
    """
    if not all(np.isfinite(length) and length > 0 for length in lengths_m):
        raise UserError(f"drift over {list(lengths_m)} m: the lengths must be positive")
    both = matched(estimate, truth, tolerance_ns)
    way = _way(both.truth)
    if not way[-1] > 0:
        raise UserError(f"{len(way)} matched poses at one place: no way to measure a drift by")
    whole = _relative_errors(both, np.array([[0, len(way) - 1]]))
    percents = []
    for length in lengths_m:
        last = np.searchsorted(way, way + length, side="right")
        pairs = np.stack([np.arange(len(way)), last], axis=1)[last < len(way)]
        if not len(pairs):
            continue
        error = _relative_errors(both, pairs)
        percents.append(100 * np.linalg.norm(error[:, :3, 3], axis=1) / length)
    return Drift(
        float(way[-1]), float(100 * np.linalg.norm(whole[0, :3, 3]) / way[-1]),
        float(np.concatenate(percents).mean()) if percents else None, len(way), both.total,
    )  # fmt: skip


def drift_reduction(rmse_anchored: float, rmse_graph_started_at_truth: float) -> float:
    """The share of the drift that the anchors remove: 1 - RMSE(anchored) / RMSE(not anchored).

    `rmse_anchored` is the position RMSE (m) of the anchored run in the BIM frame, without alignment.
    `rmse_graph_started_at_truth` is that of the same graph without anchors, its first pose set to the true first
    pose (`ape(..., "origin").translation.rmse`). 1 is perfect, 0 no gain, negative where the anchors do harm.
    Raises UserError for values that are negative or not finite, and where there is no drift to reduce.
    """
    if not (np.isfinite(rmse_anchored) and rmse_anchored >= 0):
        raise UserError(f"drift reduction: {rmse_anchored} m is no RMSE")
    if not (np.isfinite(rmse_graph_started_at_truth) and rmse_graph_started_at_truth > 0):
        raise UserError(f"drift reduction: no drift to reduce in an RMSE of {rmse_graph_started_at_truth} m")
    return 1.0 - rmse_anchored / rmse_graph_started_at_truth


def _angles(poses: Array) -> Array:
    """(N,) the angles of (N, 4, 4) poses, in [0, pi]."""
    return np.asarray(Rotation.from_matrix(poses[:, :3, :3]).magnitude())


def _way(poses: Array) -> Array:
    """(N,) metres travelled up to each pose."""
    steps = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _relative_errors(both: Matched, pairs: NDArray[np.intp]) -> Array:
    """(K, 4, 4) what the estimate's motion from i to j adds to the true one."""
    i, j = pairs.T
    true = inverse(both.truth[i]) @ both.truth[j]
    return inverse(true) @ inverse(both.estimate[i]) @ both.estimate[j]


def _pairs(way: Array, delta: float, tolerance: float) -> NDArray[np.intp]:
    """(K, 2) for each pose the later one whose way from it is nearest to `delta`, if within the tolerance."""
    first = np.arange(len(way) - 1)
    above = np.searchsorted(way, way[:-1] + delta)
    below = np.searchsorted(way, way[np.maximum(above - 1, 0)])  # the first of those that stand at one place
    above, below = (np.clip(index, first + 1, len(way) - 1) for index in (above, below))
    off_above, off_below = (np.abs(way[index] - way[:-1] - delta) for index in (above, below))
    second = np.where(off_below <= off_above, below, above)
    return np.stack([first, second], axis=1)[np.minimum(off_above, off_below) <= tolerance]
