"""Registers all scans of a run again, to one map of all of them, in one smoothing of the whole motion.

Unlike a live window, it knows what is seen later: where a stretch of the way shows nothing level, the height follows
from before and after. As in a continuous-time smoother (Anderson and Barfoot, IROS 2015) the normal equations are
banded; map and motion are estimated in turns.
"""

import math
from concurrent.futures import ThreadPoolExecutor
from itertools import repeat

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from data.common.bars import steps
from data.common.compiled import compiled
from sgslam.config import TrackingSettings
from sgslam.registration.beliefs import MotionModel
from sgslam.registration.motion import pose_at
from sgslam.registration.motion_prior import add_height, add_velocities, velocity_between
from sgslam.registration.points import (
    CONVERGED,
    FIRST_OF_KERNEL,
    KERNEL_OF_RESIDUAL,
    STRAYED,
    UNKNOWN,
    Weights,
    placed,
    point_equations,
    project_out_spurious,
)
from sgslam.registration.window import MotionPrior, update_knots, window_knots
from sgslam.surfels import SurfelMap, Surfels
from sgslam.types import Motion, TimedPoints

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
_MAPS = 2  # times that the map is made, each of the motion found before
_ITERATIONS = 4  # to each map
_TURNS = 7  # in which scans are added to a map: a surfel that is full has seen all times
_BAND = 18  # knots are coupled to the next two
_LEAST = 1e-6  # information about each direction of a knot that nothing measures
_YAW = 2  # of a velocity, about the vertical
_LEAST_POSES = 20  # of a motion that shows how its velocity changes
_UNKNOWN = 1.0  # m2, variance of the height of a scan that shows nothing level


class _Seen:
    """What a scan adds: equations H (6K, 6K), g (6K,) of its knots, and the variance (m2) of its height by its points
    alone. They are kept while its knots have hardly `moved` (m and rad), and its points' planes while they have not
    `strayed`."""

    def __init__(self, scan: TimedPoints) -> None:
        n = 6 * len(scan.knot_seconds)
        self.H, self.g, self.F = np.empty((n, n)), np.empty(n), np.empty((6, 6))
        self.plane_of = np.empty_like(scan.plane_of)
        self.moved = self.strayed = np.inf
        self.kernel, self.height_variance = 0.0, _UNKNOWN

    def begin(self, kernel: float) -> None:
        """Begins with another map, of which no plane is known, and a kernel (m)."""
        self.moved, self.strayed, self.kernel = np.inf, np.inf, kernel

    def look(self, scan: TimedPoints, knots: Floats, surfels: Surfels, weights: Weights) -> None:
        """Makes the equations of the scan, its knots at (K, 4, 4), where it has moved since."""
        error = self.kernel - weights.kernel
        if error == 0 and self.moved < CONVERGED:
            return
        if self.strayed > STRAYED:
            self.plane_of[:], self.strayed = UNKNOWN, 0.0
        points = scan.points.astype(np.float64)
        residual, _, _ = point_equations(
            points, scan.seconds, scan.knot_seconds, knots, self.plane_of, 1, surfels, -1.0, error, self.kernel,
            weights, self.H, self.g, self.F,
        )  # fmt: skip
        project_out_spurious(self.H, self.g, self.F, weights.spurious)
        self.moved, self.kernel = 0.0, min(self.kernel, max(weights.kernel, KERNEL_OF_RESIDUAL * residual))
        of_all = self.H.reshape(len(knots), 6, len(knots), 6).sum(axis=(0, 2)) + np.eye(6) / _UNKNOWN
        self.height_variance = float(np.linalg.inv(of_all)[5, 5])

    def follow(self, step: Floats) -> None:
        """Takes a step (6K,) of the knots into account."""
        self.g -= self.H @ step
        size = float(np.max(np.abs(step)))
        self.moved, self.strayed = self.moved + size, self.strayed + size


def smoothed(
    scans: list[TimedPoints], start: Motion, is_known: NDArray[np.bool_], settings: TrackingSettings
) -> Motion:
    """The motion at all knots of the scans, in the frame of `start`, which is level.

    `start` has a pose at each scan's stamp. Scans that are not `is_known` (N,) make no part of the map.
    """
    seconds, firsts = _knots_of(scans)
    motion = Motion(seconds, np.stack([pose_at(start, second) for second in seconds]))
    weights, seen = Weights.of(settings), [_Seen(scan) for scan in scans]
    knots_of = [slice(first, first + len(scan.knot_seconds)) for scan, first in zip(scans, firsts, strict=True)]
    # the first pass knows the way; unknown is how a hand sways up and down, as fast as it turns
    model = MotionModel(settings.model_copy(update={"sway_memory": settings.turn_memory}))
    model.level(np.array([0.0, 0.0, 1.0]))
    prior = _as_it_turns(model.prior, start)
    for number in range(_MAPS):
        surfels = _map_of(scans, knots_of, motion, is_known).arrays
        for own in seen:
            own.begin(settings.kernel if number else FIRST_OF_KERNEL * settings.kernel)
        for turn in range(number * _ITERATIONS, (number + 1) * _ITERATIONS):
            with ThreadPoolExecutor() as threads:
                knots = [motion.knots[own] for own in knots_of]
                looked = threads.map(_Seen.look, seen, scans, knots, repeat(surfels), repeat(weights))
                for _ in steps(seen, f"second pass, {turn + 1} of at most {_MAPS * _ITERATIONS}"):
                    next(looked)
            step = _solved(seen, firsts, motion, prior, weights)
            update_knots(motion.knots, step)
            if np.sqrt(np.mean(step**2)) < CONVERGED:
                break
            for own, its in zip(seen, knots_of, strict=True):
                own.follow(step[6 * its.start : 6 * its.stop])
    return motion


def _as_it_turns(prior: MotionPrior, motion: Motion) -> MotionPrior:
    """The prior with the spread of the angular velocity about the vertical that `motion` has: that of its changes from
    one pair of scans to the next, which the noise of single poses hardly changes.

    With a wider one, each half of a scan follows the errors of the walls that it sees, where the other half sees other
    walls. Tilt is shown by floor and ceiling, which both see.
    """
    poses, seconds = motion.knots[::2], motion.seconds[::2]
    if len(poses) < _LEAST_POSES:
        return prior
    pairs = zip(poses, poses[1:], np.diff(seconds), strict=False)
    rate = np.array([velocity_between(before, after, lasted)[_YAW] for before, after, lasted in pairs])
    kept = np.exp(-np.diff((seconds[1:] + seconds[:-1]) / 2) / prior.memory[_YAW])
    spread = prior.spread.copy()
    spread[_YAW] = min(spread[_YAW], np.sqrt(np.mean((rate[1:] - kept * rate[:-1]) ** 2 / (1 - kept**2))))
    return prior._replace(spread=spread)


def _knots_of(scans: list[TimedPoints]) -> tuple[Floats, list[int]]:
    """The times (K,) of all knots, and the index of each scan's first one."""
    first, *others = [scan.knot_seconds for scan in scans]
    if len(first) > 1:
        return window_knots(float(first[0]), [first, *others])
    seconds, firsts = window_knots(float(first[0]), others)
    return seconds, [0, *firsts]


def _map_of(scans: list[TimedPoints], knots_of: list[slice], motion: Motion, is_known: NDArray[np.bool_]) -> SurfelMap:
    surfels = SurfelMap()
    for turn in range(_TURNS):
        for i in range(turn, len(scans), _TURNS):
            if is_known[i]:
                points, knots = scans[i].points.astype(np.float64), motion.knots[knots_of[i]]
                surfels.add(*placed(points, scans[i].seconds, scans[i].knot_seconds, knots), 0.0, 1.0)
    return surfels


def _solved(seen: list[_Seen], firsts: list[int], motion: Motion, prior: MotionPrior, weights: Weights) -> Floats:
    """(6K,) the step of all knots, by the points, the prior of the motion and the usual height."""
    band, g = np.zeros((_BAND, 6 * len(motion.knots))), np.zeros(6 * len(motion.knots))
    for own, first in zip(seen, firsts, strict=True):
        _add_block(own.H, own.g, 6 * first, band, g)
    heights = motion.knots[firsts, 2, 3]
    variances = np.array([own.height_variance for own in seen])
    usual = _usual(motion.seconds, motion.seconds[firsts], heights, variances, weights)
    _add_priors(motion.seconds, motion.knots, prior, usual, weights, band, g)
    band[0] += _LEAST
    return np.asarray(solveh_banded(band, g, lower=True))


def _usual(at: Floats, seconds: Floats, heights: Floats, variances: Floats, weights: Weights) -> Floats:
    """(K,) the usual height (m) at knots `at` (K,): the mean of that of the scans (N,) around, nearer and better known
    ones counting for more."""
    counts = 1 / (variances + weights.sway**2)
    sums = np.column_stack([counts * heights, counts])
    both = _faded(seconds, sums, at, weights.sway_memory)
    both += _faded(-seconds[::-1], sums[::-1], -at[::-1], weights.sway_memory)[::-1]
    return np.asarray(both[:, 0] / both[:, 1])


@compiled
def _faded(seconds: Floats, sums: Floats, at: Floats, memory: float) -> Floats:
    """(K, 2) at each of `at`, the `sums` (N, 2) of all earlier times, faded exponentially."""
    found, kept, then, i = np.zeros((len(at), 2)), np.zeros(2), at[0], 0
    for k in range(len(at)):
        kept *= math.exp(-(at[k] - then) / memory)
        then = at[k]
        while i < len(seconds) and seconds[i] <= at[k]:
            kept += sums[i] * math.exp(-(at[k] - seconds[i]) / memory)
            i += 1
        found[k] = kept
    return found


@compiled
def _add_block(H: Floats, g: Floats, first: int, band: Floats, whole: Floats) -> None:
    """Adds equations H (n, n), g (n,) of neighbouring unknowns, from number `first` on, to a lower band."""
    for i in range(len(g)):
        whole[first + i] += g[i]
        for j in range(i + 1):
            band[i - j, first + j] += H[i, j]


@compiled
def _add_priors(
    seconds: Floats, knots: Floats, prior: MotionPrior, usual: Floats, weights: Weights, band: Floats, g: Floats
) -> None:
    """Adds the prior of the motion, three knots at a time, and of each knot's `usual` height (K,)."""
    unknown, nothing, up = np.zeros(6), np.zeros((6, 6)), np.array([0.0, 0.0, 1.0])
    for k in range(len(knots)):
        low, high = max(k - 1, 0), min(k + 2, len(knots))
        H, own = np.zeros((18, 18)), np.zeros(18)
        if high - low == 3:
            add_velocities(
                seconds[low:high], knots[low:high], unknown, nothing, prior.spread, prior.memory, prior.axes, H, own
            )
            _add_block(H, own, 6 * low, band, g)
        lasted = (seconds[high - 1] - seconds[low]) / (high - low) / weights.sway_memory
        H, own = np.zeros((6, 6)), np.zeros(6)
        add_height(knots[k : k + 1], up, usual[k], 0.0, weights.sway, lasted, H, own)
        _add_block(H, own, 6 * k, band, g)
