"""How good a registration is, and the other poses that are tried where it is poor or the sensor is lost."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from data.common.compiled import compiled
from sgslam.config import TrackingSettings
from sgslam.geometry.frames import levelling
from sgslam.registration.points import FIRST_OF_KERNEL
from sgslam.registration.window import Solved
from sgslam.surfels.planes import SIDES, cell_of, key_of
from sgslam.surfels.search import FOLLOWED, Surfels, is_met_in, nearest_plane
from sgslam.types import Health

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Guess = list[Floats]  # the poses (4, 4) of the knots that are not known yet
_LOST_TURNS = (-60.0, -30.0, 30.0, 60.0, 90.0)  # degrees about each axis, while the sensor was lost
_SWINGS = (-36.0, -18.0, 18.0, 36.0)  # degrees from the prediction: a hand turns back by as much within a scan
_WIDE_OF_KERNEL = 8.0  # times the kernel, after a poor prediction
_ITERATIONS = 16  # at most
_FEW = 4  # iterations that show which of many predictions lead to the map,
_SAMPLE = 4  # with one of so many points
_FINISHED = 2  # of these predictions, so many
_MOST = 300  # points that are compared for each pose of the grid
_YAW, _TILT = 15.0, 20.0  # degrees, steps of the grid
_REACH = 2  # steps of the grid, half its width
_STEP = 0.5  # m, a step of the grid
_OFF = 0.4  # m: a point of a pose half a grid step away is this far from its surface
_EVERY = 8  # of the points, one whose ray is followed
_BEFORE = 0.5  # m before its end, a ray may meet the surface that it has measured
SUSPICIOUS = 0.85  # times the usual share of explained points; below, a scan is tried again, a lost one stays lost
_LOST = 0.4  # times the usual share; 0.5 at a step of 0.7 m into unknown space
_AGREEMENT = 0.7  # share of the points near a surface that it explains; 0.9 in clutter
_INNOVATION = 60.0  # squared Mahalanobis distance from the prediction; chi-squared, 6 degrees of freedom
_MOST_RAYS = 0.5  # share that no person who went away leaves free, since he stood on one side of the sensor


def best_attempt(
    attempt: Callable[[Guess, float, int, int], Solved], fits: Callable[[Solved], bool], ahead: Guess,
    stopped: Guess | None, given: Guess | None, was_lost: bool, turn_known: bool, settings: TrackingSettings,
) -> Solved:  # fmt: skip
    """The best result of `attempt`, which registers a scan from predicted poses (4, 4) of its knots, with a kernel (m),
    a largest number of iterations, and one of so many points.

    Those `ahead` are expected. If the result does not fit, they are tried with a wide kernel, as is a sensor that
    `stopped`, unless it is known by an accelerometer that it did not, or moved as another system has `given`, or turned
    there while it was lost; then one that swung to another attitude than ahead. Where the turn is known, by a
    gyroscope, no other one is tried.
    """

    wide = _WIDE_OF_KERNEL * settings.kernel

    def closest(best: Solved, guesses: list[Guess]) -> Solved:
        if len(guesses) > _FINISHED:
            close = np.array([attempt(guess, wide, _FEW, _SAMPLE).close for guess in guesses])
            chosen = np.argsort(close, kind="stable")[-_FINISHED:]
            guesses = [guesses[i] for i in sorted(chosen) if _SAMPLE * close[i] > best.close]
        finished = [attempt(guess, wide, _ITERATIONS, 1) for guess in guesses]
        return max([best, *finished], key=lambda solved: solved.close)

    best = attempt(ahead, FIRST_OF_KERNEL * settings.kernel, _ITERATIONS, 1)
    if fits(best):
        return best
    turned = [] if stopped is None or turn_known or not was_lost else _turned(stopped, _LOST_TURNS)
    best = closest(best, [ahead, *(own for own in (stopped, given) if own is not None), *turned])
    if fits(best) or was_lost or turn_known:
        return best
    swung = closest(best, _turned(ahead, _SWINGS))
    return swung if fits(swung) else best  # some fit a little by chance


def _turned(guess: Guess, degrees: tuple[float, ...]) -> list[Guess]:
    """The same poses (4, 4) turned about each axis of the sensor, since its mount is not known, by each angle."""
    turns = np.tile(np.eye(4), (3 * len(degrees), 1, 1))
    vectors = [np.radians(angle) * axis for axis in np.eye(3) for angle in degrees]
    turns[:, :3, :3] = Rotation.from_rotvec(vectors).as_matrix()
    return [[pose @ turn for pose in guess] for turn in turns]


def likely_poses(
    points: Floats, T_near: Floats, up: Floats, surfels: Surfels, oldest: float, count: int
) -> list[Floats]:
    """The `count` best poses T_odom_sensor (4, 4) of a sensor that saw points (N, 6), with the normals of their
    surfaces.

    It is about `T_near` (4, 4): a metre away at most, tilted by 20 degrees at most, with any heading about `up` (3,).
    """
    own = points[np.random.default_rng(0).permutation(len(points))[:_MOST]]
    levelled = levelling(up)  # rows: two level directions, and up
    steps = _STEP * np.arange(-_REACH, _REACH + 1)
    shifts = np.array([[x, y] for x in steps for y in steps]) @ levelled[:2]
    yaws = Rotation.from_rotvec(np.arange(0, 360, _YAW)[:, None] * up, degrees=True)
    tilts = _TILT * np.array([(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)]) @ levelled[:2]
    turns = np.stack([(yaw * tilt).as_matrix() for yaw in yaws for tilt in Rotation.from_rotvec(tilts, degrees=True)])
    poses = np.tile(np.eye(4), (len(turns), len(shifts), 1, 1))
    poses[:, :, :3, :3] = (turns @ T_near[:3, :3])[:, None]
    poses[:, :, :3, 3] = T_near[:3, 3] + shifts
    poses = poses.reshape(-1, 4, 4)
    scores = _scores(poses, own, surfels, oldest)
    return list(poses[np.argsort(-scores, kind="stable")[:count]])


@compiled
def _scores(poses: Floats, points: Floats, surfels: Surfels, oldest: float) -> Floats:
    """How many points have a plane in reach, for each pose (P, 4, 4)."""
    scores, at = np.zeros(len(poses)), np.empty((2, 3))
    for n in range(len(poses)):
        T = poses[n]
        sensor = (T[0, 3], T[1, 3], T[2, 3])
        for p in range(len(points)):
            for half in range(2):  # the place, then the normal
                for i in range(3):
                    x, y, z = points[p, 3 * half], points[p, 3 * half + 1], points[p, 3 * half + 2]
                    at[half, i] = T[i, 0] * x + T[i, 1] * y + T[i, 2] * z
            point = (at[0, 0] + sensor[0], at[0, 1] + sensor[1], at[0, 2] + sensor[2])
            normal = (at[1, 0], at[1, 1], at[1, 2])
            scores[n] += nearest_plane(point, sensor, normal, _OFF, _OFF, surfels, oldest) > 0
    return scores


def shares_seen_through(points: Floats, sensor: Floats, surfels: Surfels, oldest: float) -> tuple[float, float]:
    """Of the rays from a sensor (3,) to points (N, 3), in `odom`, the share that passes through surfaces of the map;
    and of the surfaces, the cells of the map, that they meet, the share that they pass through.

    Where a person stood whom the sensor now passes, a third of its rays pass through a single surface.
    """
    through, ends = _seen_through(points, sensor, surfels, oldest)
    cells = len(np.unique(through))
    return len(through) / max(len(ends), 1), cells / max(cells + len(np.unique(ends)), 1)


@compiled
def _seen_through(points: Floats, sensor: Floats, surfels: Surfels, oldest: float) -> tuple[Ints, Ints]:
    """The cell of the map that each ray passes through, of those that pass through one; and those of all ends."""
    rays, passed, (x, y, z) = 0, 0, (sensor[0], sensor[1], sensor[2])
    step = 0.3 * SIDES[FOLLOWED]  # along a ray, from one cell that is looked at to the next
    ends, through = np.empty(len(points), np.int64), np.empty(len(points), np.int64)
    for p in range(0, len(points), _EVERY):
        dx, dy, dz = points[p, 0] - x, points[p, 1] - y, points[p, 2] - z
        length = math.sqrt(dx * dx + dy * dy + dz * dz)
        ray = (dx / length, dy / length, dz / length)
        ends[rays] = key_of(cell_of(points[p, 0], points[p, 1], points[p, 2]), FOLLOWED)
        rays += 1
        at = step
        while at < length - _BEFORE:
            cell = cell_of(x + at * ray[0], y + at * ray[1], z + at * ray[2])
            if is_met_in(cell, (x, y, z), ray, length - _BEFORE, surfels, oldest):
                through[passed] = key_of(cell, FOLLOWED)
                passed += 1
                break
            at += step
    return through[:passed], ends[:rays]


def fits(solved: Solved, usual: float) -> bool:
    """Whether about as large a share of the newest scan's points as is `usual` lie on known surfaces."""
    return solved.share >= SUSPICIOUS * usual and solved.agreement >= _AGREEMENT


def innovation(solved: Solved) -> float:
    """Squared Mahalanobis distance of the last knot from the one that the motion prior predicted, of 6 dimensions."""
    off = np.empty(6)
    turned = solved.knots[-1, :3, :3] @ solved.predicted[-1, :3, :3].T
    off[:3] = np.array([turned[2, 1] - turned[1, 2], turned[0, 2] - turned[2, 0], turned[1, 0] - turned[0, 1]]) / 2
    off[3:] = solved.knots[-1, :3, 3] - solved.predicted[-1, :3, 3]
    return float(off @ solved.predicted_information[-1] @ off)


def judged(
    solved: Solved, covariance: Floats, relative: float, was_lost: bool, settings: TrackingSettings
) -> tuple[Health, Floats]:
    """The health of a scan with a covariance (6, 6), rotation first, as its points are weighted, and with a share of
    points on known surfaces that is so many times the usual one; and the unit twists (M, 6) that are not constrained.

    A sensor that was lost must fit better, and be constrained in all directions: of the many poses that are tried then,
    some fit by chance.
    """
    unlike = relative < (SUSPICIOUS if was_lost else _LOST) or solved.agreement < _AGREEMENT
    if unlike or innovation(solved) > _INNOVATION:
        return "lost", np.empty((0, 6))
    weak = []
    for part, most in ((0, settings.degraded_rotation), (3, settings.degraded_translation)):
        variances, axes = np.linalg.eigh(covariance[part : part + 3, part : part + 3])
        for axis in axes.T[variances > most**2]:
            twist = np.zeros(6)
            twist[part : part + 3] = axis
            weak.append(twist)
    if not weak:
        return "good", np.empty((0, 6))
    return ("lost", np.empty((0, 6))) if was_lost else ("degraded", np.stack(weak))


def sees_through(points: Floats, sensor: Floats, surfels: Surfels, oldest: float, settings: TrackingSettings) -> bool:
    """Whether the rays from a sensor (3,) to points (N, 3), in `odom`, pass through too many surfaces of the map: its
    pose is wrong, or people who stood there went away."""
    of_rays, of_surfaces = shares_seen_through(points, sensor, surfels, oldest)
    return of_rays > _MOST_RAYS or of_surfaces > settings.seen_through
