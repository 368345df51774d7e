"""Registers all scans of a run again, to one map of all of them, in one smoothing of the whole motion.

Unlike a live window, it knows what is seen later: where a stretch of the way shows nothing level, the height follows
from before and after. As in a continuous-time smoother (Anderson and Barfoot, IROS 2015) the normal equations are
banded; map and motion are estimated in turns.
"""

import math
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

from data.common.compiled import compiled
from sgslam.config import TrackingSettings
from sgslam.registration.beliefs import MotionModel
from sgslam.registration.correspondences import find_planes
from sgslam.registration.degeneracy import project_out_feigned
from sgslam.registration.motion_prior import add_height, add_velocities
from sgslam.registration.point_to_plane import add_points
from sgslam.registration.sampling import TimedPoints
from sgslam.registration.types import Motion
from sgslam.registration.window import MotionPrior, Weights, robust_scales, update_knots, window_knots
from sgslam.surfels import SurfelMap, Surfels

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
_UP = np.array([0.0, 0.0, 1.0])
_MAPS = 2  # times that the map is made, each of the motion found before
_ITERATIONS = 4  # to each map
_TURNS = 7  # in which scans are added to a map: a surfel that is full has seen all times
_BAND = 18  # knots are coupled to the next two
_LEAST = 1e-6  # information about each direction of a knot that nothing measures
_UNKNOWN = 1.0  # m2, variance of the height of a scan that shows nothing level


class _Seen(NamedTuple):
    """What a scan adds: equations H (6K, 6K), g (6K,) of its knots, its points' median residual (m), and the variance
    (m2) of its height by its points alone."""

    H: Floats
    g: Floats
    residual: float
    height_variance: float


def smoothed(
    scans: list[TimedPoints], start: Motion, is_known: NDArray[np.bool_], settings: TrackingSettings
) -> Motion:
    """The motion at all knots of the scans, in the frame of `start`, which is level.

    `start` has a pose at each scan's stamp. Scans that are not `is_known` (N,) make no part of the map.
    """
    seconds, firsts = _knots_of(scans)
    motion = Motion(seconds, np.stack([start.at(second) for second in seconds]))
    weights, sigmas = Weights.of(settings), np.full(len(scans), settings.sigma_point)
    # the first pass knows the way; unknown is how a hand sways up and down, as fast as it turns
    model = MotionModel(settings.model_copy(update={"vertical_memory": settings.turn_memory}))
    model.level(_UP)
    for number in range(_MAPS):
        surfels = _map_of(scans, firsts, motion, is_known).arrays
        kernel = settings.kernel if number else settings.first_kernel
        for _ in range(_ITERATIONS):
            error = kernel - weights.kernel
            seen = _look(scans, firsts, motion.knots, surfels, error, kernel, sigmas, weights)
            step = _solved(seen, firsts, motion, model.prior, weights)
            update_knots(motion.knots, step)
            if np.sqrt(np.mean(step**2)) < settings.convergence:
                break
            scales = [robust_scales(own.residual, kernel, weights) for own in seen]
            kernel, sigmas = float(np.median([scale for scale, _ in scales])), np.array([sigma for _, sigma in scales])
    return motion


def _knots_of(scans: list[TimedPoints]) -> tuple[Floats, list[int]]:
    """The times (K,) of all knots, and the index of each scan's first one."""
    first, *others = [scan.knot_seconds for scan in scans]
    if len(first) > 1:
        return window_knots(float(first[0]), [first, *others])
    seconds, firsts = window_knots(float(first[0]), others)
    return seconds, [0, *firsts]


def _map_of(scans: list[TimedPoints], firsts: list[int], motion: Motion, is_known: NDArray[np.bool_]) -> SurfelMap:
    surfels = SurfelMap()
    for turn in range(_TURNS):
        for i in range(turn, len(scans), _TURNS):
            if is_known[i]:
                scan, own = scans[i], slice(firsts[i], firsts[i] + len(scans[i].knot_seconds))
                points = scan.points.astype(np.float64)
                own_motion = Motion(scan.knot_seconds, motion.knots[own])
                placed = own_motion.placed(points, scan.seconds)
                surfels.add(placed, own_motion.rays(placed, scan.seconds), 0.0, 1.0)
    return surfels


def _look(
    scans: list[TimedPoints], firsts: list[int], knots: Floats, surfels: Surfels, error: float, kernel: float,
    sigmas: Floats, weights: Weights,
) -> list[_Seen]:  # fmt: skip
    """What each scan adds, with its knots at (K, 4, 4)."""
    look = partial(_equations, surfels=surfels, error=error, kernel=kernel, weights=weights)
    owns = [knots[first : first + len(scan.knot_seconds)] for scan, first in zip(scans, firsts, strict=True)]
    with ThreadPoolExecutor() as threads:
        return list(threads.map(look, scans, owns, sigmas))


def _equations(
    scan: TimedPoints, knots: Floats, sigma: float, surfels: Surfels, error: float, kernel: float, weights: Weights
) -> _Seen:
    knot, share = scan.between(0)
    points = scan.points.astype(np.float64)
    H, g, residual = _scan_equations(points, knot, share, knots, surfels, error, kernel, sigma**2, weights)
    pieces = len(knots)
    of_all = H.reshape(pieces, 6, pieces, 6).sum(axis=(0, 2)) + np.eye(6) / _UNKNOWN
    return _Seen(H, g, residual, float(np.linalg.inv(of_all)[5, 5]))


@compiled
def _scan_equations(
    points: Floats, knot: Ints, share: Floats, knots: Floats, surfels: Surfels, error: float, kernel: float,
    variance: float, weights: Weights,
) -> tuple[Floats, Floats, float]:  # fmt: skip
    n = 6 * len(knots)
    H, g, F = np.zeros((n, n)), np.zeros(n), np.zeros((6, 6))
    moved, plane_of = np.empty((len(points), 3)), np.empty(len(points), np.int64)
    find_planes(points, knot, share, knots, surfels, -1.0, weights.gate, error, moved, plane_of)
    residual, _, _ = add_points(
        moved, plane_of, knot, share, knots, surfels.planes, error, kernel, variance, weights.near, 0, H, g, F
    )
    project_out_feigned(H, g, F, weights.feigned)
    return H, g, residual


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
    before, after = (_faded(seconds, sums, at, weights.sway_memory), _faded(-seconds, sums, -at, weights.sway_memory))
    both = before + after
    return np.asarray(both[:, 0] / both[:, 1])


def _faded(seconds: Floats, sums: Floats, at: Floats, memory: float) -> Floats:
    """(K, 2) at each of `at`, the `sums` (N, 2) of all earlier times, faded exponentially."""
    forward = seconds[-1] >= seconds[0]
    order, places = (slice(None), np.arange(len(at))) if forward else (slice(None, None, -1), np.arange(len(at))[::-1])
    return _fade(seconds[order], sums[order], at[places], memory)[np.argsort(places)]


@compiled
def _fade(seconds: Floats, sums: Floats, at: Floats, memory: float) -> Floats:
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
