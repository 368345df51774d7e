"""Trajectory errors against the ground truth. Pure functions: no files, no plots.

Errors in the BIM frame are computed without alignment. The map's trajectory and the odometry, each in a frame of its
own, are aligned to the truth first.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.trajectory import Trajectory

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

TOLERANCE_NS = 10_000_000  # half the period of a 50 Hz ground truth
STANDING_M = 0.05  # spread of a trajectory below which its orientation is undetermined
STRAIGHT_RATIO = 1e-5  # second to first singular value of the covariance of a straight line (0.3 % in length)


def associate(
    estimate_ns: NDArray[np.int64], truth_ns: NDArray[np.int64], tolerance_ns: int = TOLERANCE_NS
) -> tuple[Indices, Indices]:
    """Pairs stamps by time: each estimate with its nearest truth, each truth with one estimate at most.

    Both arrays are int64 ns, strictly increasing. Returns the indices into both, (M,) each and increasing;
    where two estimates share their nearest truth, the nearer one is paired and the other stays unmatched.
    """
    none = np.empty(0, dtype=np.intp)
    if not len(estimate_ns) or not len(truth_ns):
        return none, none
    after = np.clip(np.searchsorted(truth_ns, estimate_ns), 1, max(len(truth_ns) - 1, 1))
    before, after = after - 1, np.minimum(after, len(truth_ns) - 1)
    nearer_before = estimate_ns - truth_ns[before] <= truth_ns[after] - estimate_ns
    nearest = np.where(nearer_before, before, after)
    gap = np.abs(estimate_ns - truth_ns[nearest])
    order = np.lexsort((gap, nearest))  # by truth, the nearest estimate first
    first = np.ones(len(order), dtype=bool)
    first[1:] = nearest[order][1:] != nearest[order][:-1]
    kept = np.sort(order[first & (gap[order] <= tolerance_ns)])
    return kept, nearest[kept]


def align_se3(points: Array, targets: Array) -> Array:
    """The rigid motion (4, 4) that takes `points` (N, 3) onto `targets` (N, 3) with least squares error.

    Umeyama, "Least-squares estimation of transformation parameters between two point patterns", PAMI 1991,
    without scale. Raises UserError where the points stand still or lie on one line: the turn about that line
    would be arbitrary.
    """
    centre_p, centre_t = points.mean(axis=0), targets.mean(axis=0)
    p, t = points - centre_p, targets - centre_t
    spread = min(np.sqrt((p**2).sum(axis=1).mean()), np.sqrt((t**2).sum(axis=1).mean()))
    if len(points) < 3 or spread < STANDING_M:
        raise UserError(f"{len(points)} matched poses spread over {spread:.3f} m: too little motion to align")
    U, D, Vt = np.linalg.svd(t.T @ p / len(p))
    if D[1] < STRAIGHT_RATIO * D[0]:
        raise UserError("the trajectory is a straight line: its alignment to the truth is not determined")
    S = np.diag([1.0, 1.0, np.sign(np.linalg.det(U) * np.linalg.det(Vt))])
    T_target_point = np.eye(4)
    T_target_point[:3, :3] = U @ S @ Vt
    T_target_point[:3, 3] = centre_t - T_target_point[:3, :3] @ centre_p
    return T_target_point


def yaw_errors(estimate: Array, truth: Array) -> Array:
    """(N,) radians in (-pi, pi]: the turn about z that takes each true pose nearest to the estimate.

    Both are (N, 4, 4) in one frame. It is the twist of R_estimate R_truth^T about z, so it holds for any
    mounting of the sensor.
    """
    R = estimate[:, :3, :3] @ truth[:, :3, :3].transpose(0, 2, 1)
    return np.arctan2(R[:, 1, 0] - R[:, 0, 1], R[:, 0, 0] + R[:, 1, 1])


def accuracy(
    trajectory_in_bim: Trajectory | None,
    trajectory_map: Trajectory,
    odometry: Trajectory | None,
    truth_in_bim: Trajectory,
    tolerance_ns: int = TOLERANCE_NS,
) -> dict[str, Any]:
    """The `accuracy` of metrics.json: metres and degrees over the poses that match a true pose in time.

    `trajectory_in_bim` is None where the run was not anchored, and the three `..._bim_...` are None then.
    `trajectory_map` holds poses in one map frame. `rmse_map_aligned_m` and `rmse_odometry_aligned_m` are RMSEs of its
    and the odometry's positions, each after SE(3) alignment of its own, or None where it cannot be aligned; `note`
    gives the reason. `odometry` is None where it began again, in another frame. Raises UserError where no pose matches.
    """
    scored = trajectory_map if trajectory_in_bim is None else trajectory_in_bim
    ours, true = associate(scored.stamps_ns, truth_in_bim.stamps_ns, tolerance_ns)
    if not len(ours):
        raise UserError(
            f"ground truth: no pose within {tolerance_ns / 1e9:g} s of any scan; its stamps must use the scans' clock"
        )
    result: dict[str, Any] = dict.fromkeys(("rmse_bim_m", "max_bim_m", "yaw_rmse_bim_deg"))
    if trajectory_in_bim is not None:
        errors = np.linalg.norm(scored.positions[ours] - truth_in_bim.positions[true], axis=1)
        yaw = yaw_errors(scored.poses[ours], truth_in_bim.poses[true])
        result["rmse_bim_m"], result["max_bim_m"] = _rms(errors), float(errors.max())
        result["yaw_rmse_bim_deg"] = float(np.degrees(_rms(yaw)))
    for name, estimate in (("map", trajectory_map), ("odometry", odometry)):
        key = f"rmse_{name}_aligned_m"
        result[key] = None
        try:
            if estimate is None:
                raise UserError("the odometry restarted where the sensor was carried elsewhere, or was lost")
            result[key] = rmse_aligned(estimate, truth_in_bim, tolerance_ns)
        except UserError as error:
            result["note"] = str(error)
    return result | {"matched_poses": len(ours), "total_poses": len(scored)}


def rmse_aligned(estimate: Trajectory, truth: Trajectory, tolerance_ns: int = TOLERANCE_NS) -> float:
    """The root mean square position error (m) after SE(3) alignment of the matched poses.

    Raises UserError where the alignment is not determined.
    """
    ours, true = associate(estimate.stamps_ns, truth.stamps_ns, tolerance_ns)
    if len(ours) < 3:
        raise UserError(f"{len(ours)} matched poses: too few to align to the truth")
    points, targets = estimate.positions[ours], truth.positions[true]
    T = align_se3(points, targets)
    return _rms(np.linalg.norm(points @ T[:3, :3].T + T[:3, 3] - targets, axis=1))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
