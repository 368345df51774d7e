"""Estimates the knots of a window of scans from their points and the prior of the motion, by Gauss-Newton."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from sgslam.config import TrackingSettings
from sgslam.geometry.normal_equations import solved, square_up
from sgslam.geometry.rotations import rotated_by
from sgslam.inertial import Changes, Turns
from sgslam.registration.correspondences import planes_of
from sgslam.registration.degeneracy import project_out_feigned
from sgslam.registration.motion_prior import (
    Steps,
    add_changes,
    add_height,
    add_pose,
    add_steps,
    add_turns,
    add_velocities,
    velocity_between,
)
from sgslam.registration.moving_points import placed
from sgslam.registration.point_to_plane import add_points
from sgslam.surfels import Surfels

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_KERNEL = 5.0  # times the median residual
_SIGMA = 6.0  # times the median residual, a point's sigma: an a-posteriori variance factor, as neighbours share errors
_SETTLED = 4.0  # times the convergence: after a smaller step, fewer than one point in a hundred is on another plane
_GAP = 0.02  # of a scan's duration: a shorter pause after the scan before is none; a quick hand turns by 0.4 degrees


class Prior(NamedTuple):
    """What is known before: of the window's first knot the pose (4, 4) and its information (6, 6), of the motion after
    it the velocity (6,) and its information (6, 6); of all knots the usual height (m) along `up` (3,), zero while that
    is unknown; and the variance (m2) of the first knot's height."""

    T: Floats
    information: Floats
    velocity: Floats
    velocity_information: Floats
    up: Floats
    height: float
    height_variance: float


class MotionPrior(NamedTuple):
    """An Ornstein-Uhlenbeck process: `spread` (6,) of the velocity, rad/s and m/s, and its `memory` (6,) in seconds,
    along the rows of `axes` (6, 6)."""

    spread: Floats
    memory: Floats
    axes: Floats


class Weights(NamedTuple):
    """The part of `TrackingSettings` that the registration needs, as it names them."""

    sigma_point: float
    gate: float
    kernel: float
    near: float
    feigned: float
    sway: float
    sway_memory: float
    convergence: float
    iterations: int

    @staticmethod
    def of(settings: TrackingSettings) -> "Weights":
        """Takes them from the settings."""
        return Weights(*(getattr(settings, name) for name in Weights._fields))


@dataclass(frozen=True, eq=False)
class Solved:
    """A window: its knots (K, 4, 4) at `seconds` (K,), their information (6K, 6K), that of the points and of another
    system's steps alone, and the knots as the prior predicted them.

    Of so many points of the newest scan, `found` ones have a plane in reach, and `close` ones lie near it; `residual`
    (m) is the median distance of the points of all scans.
    """

    seconds: Floats
    knots: Floats
    predicted: Floats
    information: Floats
    measured: Floats
    points: int
    found: int
    close: int
    residual: float

    @property
    def agreement(self) -> float:
        """The share of the newest scan's points found that lie near their planes."""
        return self.close / max(self.found, 1)

    @property
    def share(self) -> float:
        """The share of the newest scan's points that lie near a plane."""
        return self.close / max(self.points, 1)

    @cached_property
    def covariance(self) -> Floats:
        """(6K, 6K) of all knots; rotation first, in axes of `odom`."""
        C = np.linalg.inv(self.information)
        return np.asarray((C + C.T) / 2, np.float64)  # what is not symmetric would grow from scan to scan

    def covariance_in_sensor(self, knot: int, steady: bool) -> Floats:
        """(6, 6) of one knot; rotation first, in the sensor's axes.

        Points that were measured between the knots suffer from motion that is not `steady` there.
        """
        turn = np.kron(np.eye(2), self.knots[knot, :3, :3])
        own = slice(6 * knot, 6 * knot + 6)
        bent = np.zeros(6) if steady else self._bent()
        return np.asarray(turn.T @ (self.covariance[own, own] + np.diag(bent)) @ turn)

    def _bent(self) -> Floats:
        """(6,) the variance of a knot's error as the motion bends between knots: an arc's height above its chord."""
        lasted = np.diff(self.seconds)
        pairs = zip(self.knots[:-1], self.knots[1:], lasted, strict=True)
        velocities = np.stack([velocity_between(T_a, T_b, seconds) for T_a, T_b, seconds in pairs])
        heights = np.diff(velocities, axis=0) * np.mean(lasted) / 8
        return np.asarray(np.mean(heights**2, axis=0)) if len(heights) else np.zeros(6)


def window_knots(begin: float, scans: list[Floats]) -> tuple[Floats, list[int]]:
    """The times (K,) of the knots of a window that begins at `begin` (s), and the index of each scan's first one.

    A scan's own knots (n,) share the first one with the end of the scan before, where it follows at once.
    """
    seconds, firsts = [begin], []
    for own in scans:
        joined = len(own) > 1 and own[0] - seconds[-1] < _GAP * (own[-1] - own[0])
        if joined:
            seconds[-1] = float(own[0])
        firsts.append(len(seconds) - joined)
        seconds += own[int(joined) :].tolist()
    return np.array(seconds), firsts


def solve(
    seconds: Floats, predicted: Floats, prior: Prior, motion: MotionPrior, points: Floats, knot: Ints,
    share: Floats, newest: int, surfels: Surfels, oldest: float, first_kernel: float, weights: Weights,
    turns: Turns, changes: Changes, steps: Steps,
) -> Solved:  # fmt: skip
    """Estimates all knots from the `predicted` ones (K, 4, 4) at `seconds` (K,).

    Points (N, 6), with the normals that the scan shows, were measured a `share` (N,) of the way from their `knot` (N,)
    to the next one; those from the `newest` one on are of the newest scan. The robust kernel follows the residuals,
    from `first_kernel` to that of the weights (m): a wide one finds the way from a poor prediction, a narrow one
    rejects outliers. A point's place counts as known to the difference. `turns` are those of a gyroscope, `changes`
    those of the velocity by an accelerometer, at all but the last knot. `steps` are those of another system.

    Most of the time goes into finding the points' planes; they are kept over the last, small steps.
    """
    knots, n, moved_by, plane_of = predicted.copy(), 6 * len(predicted), np.inf, np.empty(0, np.int64)
    H, measured, kernel, sigma = np.empty((n, n)), np.empty((n, n)), first_kernel, weights.sigma_point
    for _ in range(weights.iterations):
        error = kernel - weights.kernel
        if error > 0 or moved_by > _SETTLED * weights.convergence:
            moved, plane_of = planes_of(points, knot, share, knots, surfels, oldest, weights.gate, error)
        else:
            moved = placed(points, knot, share, knots)
        residual, found, close, moved_by = _step(
            seconds, knots, prior, motion, moved, plane_of, knot, share, newest, surfels.planes, error, kernel, sigma,
            weights, turns, changes, steps, H, measured,
        )  # fmt: skip
        if moved_by < weights.convergence:
            break
        kernel, sigma = robust_scales(residual, kernel, weights)
    return Solved(seconds, knots, predicted, H, measured, len(points) - newest, found, close, residual)


@compiled
def _step(
    seconds: Floats, knots: Floats, prior: Prior, motion: MotionPrior, moved: Floats, plane_of: Ints, knot: Ints,
    share: Floats, newest: int, planes: Floats, error: float, kernel: float, sigma: float, weights: Weights,
    turns: Turns, changes: Changes, steps: Steps, H: Floats, measured: Floats,
) -> tuple[float, int, int, float]:  # fmt: skip
    """Moves the knots by one step of Gauss-Newton; fills in H and what of it is `measured`.

    Returns as `add_points`, and the largest change.
    """
    g, F = np.zeros(len(H)), np.zeros((6, 6))
    H[:, :] = 0.0
    residual, found, close = add_points(
        moved, plane_of, knot, share, knots, planes, error, kernel, sigma**2, weights.near, newest, H, g, F
    )
    project_out_feigned(H, g, F, weights.feigned)
    add_steps(knots, steps, H, g)
    measured[:, :] = H
    add_pose(knots[0], prior.T, prior.information, H, g)
    add_velocities(
        seconds, knots, prior.velocity, prior.velocity_information, motion.spread, motion.memory, motion.axes, H, g
    )
    add_turns(knots, turns, H, g)
    add_changes(seconds, knots, changes, H, g)
    lasted = (seconds[-1] - seconds[0]) / weights.sway_memory
    add_height(knots, prior.up, prior.height, prior.height_variance, weights.sway, lasted, H, g)
    step = solved(H, g)
    update_knots(knots, step)
    return residual, found, close, float(np.max(np.abs(step)))


@compiled
def robust_scales(residual: float, kernel: float, weights: Weights) -> tuple[float, float]:
    """The next iteration's kernel (m), and a point's standard deviation (m), by the median `residual` (m)."""
    return min(kernel, max(weights.kernel, _KERNEL * residual)), max(weights.sigma_point, _SIGMA * residual)


@compiled
def update_knots(knots: Floats, step: Floats) -> None:
    """Moves knots (K, 4, 4) in place by the negative of a step (6K,)."""
    for k in range(len(knots)):
        _update(knots[k], step[6 * k : 6 * k + 6])


@compiled
def _update(T: Floats, step: Floats) -> None:
    """Moves a pose (4, 4) in place by the negative of a step (6,), and squares its rotation up."""
    turn = -step[0], -step[1], -step[2]
    for j in range(3):
        T[0, j], T[1, j], T[2, j] = rotated_by(*turn, T[0, j], T[1, j], T[2, j])
    for i in range(3):
        T[i, 3] -= step[3 + i]
    square_up(T)
