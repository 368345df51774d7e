"""Errors of tracking (of the motion over a second, and of single steps), and whether what a tracker says of its poses
holds: their covariances, their health, and which way is up."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from data.common.errors import UserError
from data.trajectory import Trajectory
from sgslam.geometry.frames import inverse, local_coordinates

Array = NDArray[np.float64]
TOLERANCE = 0.05  # of the time between the poses of a pair: half a scan of ten a second
Flags = NDArray[np.bool_]
WRONG_M = 0.2
UP_AFTER_S = 5.0  # from when on a tracker must know where up is
DOF, LEVEL = 6, 0.95


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


@dataclass(frozen=True, eq=False)
class PoseClaims:
    """What a tracker says of its N poses: their `covariances` (N, 6, 6), rotation first, in the sensor's axes; whether
    each is good, degraded or lost; and where up is, unit vectors (N, 3) in the sensor frame."""

    covariances: Array
    health: NDArray[np.str_]
    up_in_sensor: Array


class Reliability(BaseModel):
    """How far these claims are true.

    `good`, `degraded` and `lost` are shares of the poses. `inside_95` is that of the `motions` over a second, between
    good poses, whose error is inside the 95 % region of their covariance. `wrongly_good` poses are called good beside a
    step that errs by more than 0.2 m. `up_deg` is the median error of up from 5 s on, None for a shorter drive.
    """

    model_config = ConfigDict(frozen=True)

    good: float
    degraded: float
    lost: float
    inside_95: float | None
    motions: int
    wrongly_good: int
    up_deg: float | None


def reliability(claims: PoseClaims, estimate: Trajectory, truth: Trajectory) -> Reliability:
    """The claims of a tracker about the poses that it estimates, against the truth. Raises UserError as `inside_region`
    does."""
    good = claims.health == "good"
    inside = inside_region(estimate, truth, claims.covariances, good)
    late = estimate.stamps_ns - estimate.stamps_ns[0] >= 1e9 * UP_AFTER_S
    up = np.degrees(up_errors(claims.up_in_sensor, estimate, truth)[late])
    return Reliability(
        good=float(good.mean()),
        degraded=float((claims.health == "degraded").mean()),
        lost=float((claims.health == "lost").mean()),
        inside_95=float(inside.mean()) if len(inside) else None,
        motions=len(inside),
        wrongly_good=int(wrongly_good(estimate, truth, good).sum()),
        up_deg=float(np.median(up)) if len(up) else None,
    )


def inside_region(estimate: Trajectory, truth: Trajectory, covariances: Array, good: Flags) -> Flags:
    """(K,) whether the error of each motion over a second lies inside the 95 % region of its covariance; the motions
    are those between poses that are both `good` (N,).

    `covariances` (N, 6, 6) are rotation first (rad), then translation (m), in the pose's own axes. The errors of two
    poses a second apart are taken as independent, so that of the motion has the sum of both covariances, the first one
    carried over into the axes of the second (Barfoot, State Estimation for Robotics, 2017, 7.3). Raises UserError for
    covariances of another shape or that are not positive definite.
    """
    covariances = np.asarray(covariances, dtype=float)
    if covariances.shape != (len(estimate), DOF, DOF):
        raise UserError(f"covariances of shape {covariances.shape} for {len(estimate)} poses; give (N, 6, 6)")
    from scipy.special import chdtri  # slow to import

    limit, true = float(chdtri(DOF, 1 - LEVEL)), truth.at(estimate.stamps_ns)
    pairs = errors_over_time(estimate, truth).pairs
    found = []
    for first, second in pairs[good[pairs].all(axis=1)].tolist():
        moved = inverse(estimate.poses[first]) @ estimate.poses[second]
        error = local_coordinates(moved, inverse(true[first]) @ true[second])
        carried = _adjoint(inverse(moved))
        covariance = covariances[second] + carried @ covariances[first] @ carried.T
        found.append(normalised_squared(error, covariance, second) <= limit)
    return np.array(found, dtype=bool)


def wrongly_good(estimate: Trajectory, truth: Trajectory, good: Flags, limit_m: float = WRONG_M) -> Flags:
    """(N,) which poses are called `good` (N,) though the motion from the pose before or to the next has an error above
    `limit_m`; of two neighbours both count, if both are called good."""
    wrong = step_errors(estimate, truth).translation_m > limit_m
    beside = np.zeros(len(estimate), dtype=bool)
    beside[:-1] |= wrong
    beside[1:] |= wrong
    return beside & good


def up_errors(up_in_sensor: Array, estimate: Trajectory, truth: Trajectory) -> Array:
    """(N,) radians between the direction that is taken for up, unit vectors (N, 3) in the sensor frame at the stamps of
    the estimate, and the true one."""
    true = truth.at(estimate.stamps_ns)[:, 2, :3]  # z of the BIM frame in the sensor's axes
    across = np.linalg.norm(np.cross(up_in_sensor, true), axis=1)
    return np.arctan2(across, np.einsum("ij,ij->i", up_in_sensor, true))


def _adjoint(T: Array) -> Array:
    """(6, 6) takes rotation and translation in the axes of frame b to frame a, for T_a_b (4, 4)."""
    R, t = T[:3, :3], T[:3, 3]
    across = np.array([[0.0, -t[2], t[1]], [t[2], 0.0, -t[0]], [-t[1], t[0], 0.0]])
    return np.block([[R, np.zeros((3, 3))], [across @ R, R]])


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
