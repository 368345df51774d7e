"""Estimates the knots of a window of scans from their points and the prior of the motion, by Gauss-Newton."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from sgslam.geometry.compiled import rotated_by, solved, square_up
from sgslam.inertial import Changes, Steps
from sgslam.registration.motion_prior import (
    add_changes,
    add_height,
    add_pose,
    add_steps,
    add_velocities,
    velocity_between,
)
from sgslam.registration.points import (
    CONVERGED,
    KERNEL_OF_RESIDUAL,
    LEAST_SIGMA_OF_RESIDUAL,
    SIGMA_OF_MEDIAN,
    STRAYED,
    UNKNOWN,
    Weights,
    point_equations,
    project_out_spurious,
)
from sgslam.surfels import Surfels

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Ints32 = NDArray[np.int32]

_SETTLED = 2e-3  # m and rad, by which the knots of an older scan move until its equations are made again
# So many points count as one measurement: neighbours share errors of their beam and their wall, and all points of a
# plane those of the plane. By the 1-s errors of drives in two buildings; of a narrow view the latter are most.
_ALIKE, _OF_PLANE = 4.0, 0.125  # points, and share of those on a plane
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


class Window(NamedTuple):
    """The points of a window's S scans, the older first, and what else is known of the motion at its knots.

    The points (N, 6), with the normals that the scans show, were measured at `seconds` (N,), and lie on the planes
    `plane_of` (N,) as far as these are known. Those of scan s are number `begins[s]` to `begins[s + 1]`, and its
    `counts[s]` knots are number `firsts[s]` on, of all knots at times `at` (K,). `turns` are those of a gyroscope,
    `changes` those of the velocity by an accelerometer, at all but the last knot; `steps` are those of another system.
    Surfels seen before the way `oldest` (m) are none.
    """

    points: Floats
    seconds: Floats
    plane_of: Ints32
    begins: Ints
    firsts: Ints
    counts: Ints
    at: Floats
    prior: Prior
    motion: MotionPrior
    turns: Steps
    changes: Changes
    steps: Steps
    surfels: Surfels
    oldest: float
    weights: Weights


@dataclass(frozen=True, eq=False)
class Solved:
    """A window: its knots (K, 4, 4) at `seconds` (K,), their information (6K, 6K), that of the points and of another
    system's steps alone, and the knots as the prior predicted them.

    Of the newest scan's points, `found` ones have a plane in reach, and `close` ones lie near it; `residual` (m) is
    their median distance; `plane_of` (N,) are their planes, 0 for none. After so many `iterations` it has `converged`,
    or not.

    Points were weighted by a standard deviation of `sigma` (m), which is cautious: see `variance_factor`.
    """

    seconds: Floats
    knots: Floats
    predicted: Floats
    information: Floats
    measured: Floats
    plane_of: Ints32
    found: int
    close: int
    residual: float
    iterations: int
    converged: bool
    sigma: float

    @property
    def agreement(self) -> float:
        """The share of the newest scan's points found that lie near their planes."""
        return self.close / max(self.found, 1)

    @property
    def share(self) -> float:
        """The share of the newest scan's points that lie near a plane."""
        return self.close / max(len(self.plane_of), 1)

    @cached_property
    def variance_factor(self) -> float:
        """The variance of the points' distances over that by which they were weighted (an a-posteriori variance
        factor)."""
        counts = np.bincount(self.plane_of[self.plane_of > 0])
        alike = _ALIKE + _OF_PLANE * float((counts**2).sum() / max(counts.sum(), 1))
        return min(alike * (SIGMA_OF_MEDIAN * self.residual / self.sigma) ** 2, 1.0) if counts.any() else 1.0

    @cached_property
    def covariance(self) -> Floats:
        """(6K, 6K) of all knots; rotation first, in axes of `odom`."""
        C = np.linalg.inv(self.information)
        return np.asarray((C + C.T) / 2, np.float64)  # what is not symmetric would grow from scan to scan

    @cached_property
    def predicted_information(self) -> Floats:
        """(K, 6, 6) that about each knot without the points; rotation first, in axes of `odom`."""
        C = np.linalg.inv(self.information - self.measured).reshape(len(self.knots), 6, -1, 6)
        return np.linalg.inv(np.stack([C[k, :, k] for k in range(len(self.knots))]))

    def covariances_in_sensor(self, knot: int, steady: bool) -> tuple[Floats, Floats]:
        """(6, 6) of one knot, as the points are weighted and by their variance; rotation first, in the sensor's axes.

        Points that were measured between the knots suffer from motion that is not `steady` there.
        """
        turn, own = np.zeros((6, 6)), slice(6 * knot, 6 * knot + 6)
        turn[:3, :3] = turn[3:, 3:] = self.knots[knot, :3, :3]
        before, weighted = self.predicted_information[knot], self.covariance[own, own]
        true = np.linalg.inv(before + (np.linalg.inv(weighted) - before) / self.variance_factor)
        unsteady = np.zeros(6) if steady else _bent(self.seconds, self.knots)
        weighted, true = (turn.T @ ((C + C.T) / 2 + np.diag(unsteady)) @ turn for C in (weighted, true))
        return weighted, true


@compiled
def _bent(seconds: Floats, knots: Floats) -> Floats:
    """(6,) the variance of a knot's error as the motion bends between knots (K, 4, 4) at times (K,): an arc's height
    above its chord."""
    variance, lasted = np.zeros(6), (seconds[-1] - seconds[0]) / (len(seconds) - 1)
    for k in range(2, len(knots)):
        before = velocity_between(knots[k - 2], knots[k - 1], seconds[k - 1] - seconds[k - 2])
        after = velocity_between(knots[k - 1], knots[k], seconds[k] - seconds[k - 1])
        for i in range(6):
            variance[i] += ((after[i] - before[i]) * lasted / 8) ** 2 / (len(knots) - 2)
    return variance


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


def solve(window: Window, predicted: Floats, first_kernel: float, iterations: int, every: int = 1) -> Solved:
    """Estimates all knots of a window from the `predicted` ones (K, 4, 4), in so many iterations at most, by one of
    `every` so many points.

    The robust kernel of the newest scan follows its residuals, from `first_kernel` to that of the weights (m). A
    point's place counts as known to the difference. See `_solve`.
    """
    knots, n = predicted.copy(), 6 * len(predicted)
    plane_of = window.plane_of.copy()
    H, measured = np.empty((n, n)), np.empty((n, n))
    count, moved_by, residual, found, close = _solve(
        window, knots, plane_of, first_kernel, iterations, every, H, measured
    )
    return Solved(
        window.at, knots, predicted, H, measured, plane_of[window.begins[-2] :], found, close, residual, count,
        moved_by < CONVERGED, max(window.weights.kernel, LEAST_SIGMA_OF_RESIDUAL * residual),
    )  # fmt: skip


@compiled
def _solve(
    window: Window, knots: Floats, plane_of: Ints32, first_kernel: float, iterations: int, every: int, H: Floats,
    measured: Floats,
) -> tuple[int, float, float, int, int]:  # fmt: skip
    """Moves the knots, and fills in the planes of the points, the information H and what of it is `measured`.

    Returns the number of iterations, the last step, and what `point_equations` does of the newest scan. A scan's
    equations are made again once its knots have moved, and its planes are looked for once they have moved by more: an
    older scan's, known from the window before, are hardly ever.
    """
    weights, scans, n = window.weights, len(window.firsts), 6 * len(knots)
    own_H, own_g, own_F = np.zeros((scans, n, n)), np.zeros((scans, n)), np.zeros((scans, 6, 6))
    moved, strayed = np.full(scans, np.inf), np.zeros(scans)  # since the equations, and the planes
    g, F, error, kernel = np.empty(n), np.empty((6, 6)), first_kernel - weights.kernel, first_kernel
    residual, found, close, moved_by, count = np.inf, 0, 0, np.inf, 0
    while count < iterations and (moved_by >= CONVERGED or count < 2):
        count += 1
        for s in range(scans):
            is_newest = s == scans - 1
            if moved[s] <= (CONVERGED if is_newest else _SETTLED):
                continue
            own, first = slice(window.begins[s], window.begins[s + 1]), window.firsts[s]
            if strayed[s] > STRAYED:
                plane_of[own] = UNKNOWN
                strayed[s] = 0.0
            knots_of = slice(first, first + window.counts[s])
            result = point_equations(
                window.points[own], window.seconds[own], window.at[knots_of], knots[knots_of], plane_of[own], every,
                window.surfels, window.oldest, error if is_newest else 0.0, kernel if is_newest else weights.kernel,
                weights, own_H[s], own_g[s], own_F[s],
            )  # fmt: skip
            moved[s] = 0.0
            if is_newest:
                residual, found, close = result
                kernel = min(kernel, max(weights.kernel, KERNEL_OF_RESIDUAL * residual))
                error = kernel - weights.kernel
        H[:, :], g[:], F[:, :] = 0.0, 0.0, 0.0
        for s in range(scans):
            first, size = 6 * window.firsts[s], 6 * window.counts[s]
            for i in range(size):
                g[first + i] += own_g[s, i]
                for j in range(size):
                    H[first + i, first + j] += own_H[s, i, j]
            F += own_F[s]
        project_out_spurious(H, g, F, weights.spurious)
        add_steps(knots, window.steps, H, g)
        for i in range(len(H)):
            for j in range(len(H)):
                measured[i, j] = H[i, j]
        _add_priors(window, knots, H, g)
        step = solved(H, g)
        update_knots(knots, step)
        moved_by = float(np.max(np.abs(step)))
        for s in range(scans):
            first, size = 6 * window.firsts[s], 6 * window.counts[s]
            own_step = step[first : first + size]
            for i in range(size):
                for j in range(size):
                    own_g[s, i] -= own_H[s, i, j] * own_step[j]
            moved[s] += np.max(np.abs(own_step))
            strayed[s] += np.max(np.abs(own_step))
    return count, moved_by, residual, found, close


@compiled
def _add_priors(window: Window, knots: Floats, H: Floats, g: Floats) -> None:
    """Adds all that is known but the points and another system's steps to normal equations H (6K, 6K), g (6K,)."""
    prior, motion, at, weights = window.prior, window.motion, window.at, window.weights
    add_pose(knots[0], prior.T, prior.information, H, g)
    add_velocities(
        at, knots, prior.velocity, prior.velocity_information, motion.spread, motion.memory, motion.axes, H, g
    )
    add_steps(knots, window.turns, H, g)
    add_changes(at, knots, window.changes, H, g)
    lasted = (at[-1] - at[0]) / weights.sway_memory
    add_height(knots, prior.up, prior.height, prior.height_variance, weights.sway, lasted, H, g)


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
