"""A few points of a scan, spread evenly in space, where the moving sensor was, and points as seen from one instant."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from data.common.compiled import compiled
from sgslam.config import TrackingSettings
from sgslam.config.sensor import SENSOR
from sgslam.geometry.compiled import principal_axes
from sgslam.geometry.frames import inverse, transform_points
from sgslam.inertial import steadied
from sgslam.registration.motion_prior import moved_on, velocity_between
from sgslam.registration.points import UNKNOWN, placed
from sgslam.surfels.planes import HALF, SIDES, key_of
from sgslam.types import Motion, Registration, TimedPoints, UnsteadyTurn

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Ints32 = NDArray[np.int32]
_FIRST_SIDE, _FINEST_SIDE = 0.03, 0.05  # m between the points that are used: in the first scan, and least
_PATCH = 0.25  # m, of the cells whose points show the normal of a scan's surface
_LEAST = 8  # points of such a cell
_FLAT = 4.0  # times the variance across, that along a surface in its narrower direction at least
SHORTEST = 1e-3  # s; a shorter scan is a snapshot
_SIDE = 0.1  # m between the points that are used of a scan that an external odometry registered


def thinned(
    points: Floats, point_times: Floats | None, began: float, side: float, settings: TrackingSettings
) -> tuple[TimedPoints, float]:
    """About as many points as the settings ask for, spread evenly in space, of a scan that `began` at so many seconds.

    The spacing `side` (m) follows the scans: returns that of the next one. 0 for the first scan.
    """
    side = side or _FIRST_SIDE
    own, patch_of, patches = _cells(points, side, settings.min_range, settings.max_range)
    chosen = np.hstack([points.take(own, axis=0), _normals(patches).take(patch_of, axis=0)])
    unknown = np.full(len(own), UNKNOWN, np.int32)
    if len(own) > 1.25 * settings.points:
        side *= 1.1
    elif len(own) < 0.8 * settings.points:
        side = max(side / 1.1, _FINEST_SIDE)
    first, last = (0.0, 0.0) if point_times is None else (float(point_times.min()), float(point_times.max()))
    if point_times is None or last - first < SHORTEST:
        at = began if point_times is None else began + float(np.mean(point_times))
        return TimedPoints(chosen, np.full(len(own), at), np.array([at]), unknown), side
    pieces = math.ceil((last - first) / settings.knot_interval - 1e-3)
    knots = np.linspace(began + first, began + last, pieces + 1)
    return TimedPoints(chosen, began + point_times[own], knots, unknown), side


def steadied_points(scan: TimedPoints, turn: UnsteadyTurn) -> TimedPoints:
    """The same points, of a sensor that turns steadily between the knots."""
    parts = [steadied(turn, own, scan.seconds) for own in np.hsplit(scan.points, 2)]
    return replace(scan, points=np.hstack(parts))


@compiled
def _cells(points: Floats, side: float, nearest: float, farthest: float) -> tuple[Ints, Ints, Floats]:
    """The indices (M,) of the first of points (N, 3) in each cell of `side` (m), between two ranges (m); the patch (M,)
    around each; and of each patch (P, 10) the number of all points in it, and the sums of x, y, z, xx, xy, xz, yy, yz
    and zz."""
    size, per_side, per_patch = 1, 1 / side, 1 / _PATCH
    while size < 2 * len(points):
        size *= 2
    table, keys, chosen = np.zeros(size, np.int32), np.empty(len(points), np.int64), np.empty(len(points), np.int64)
    of_patch, patch_keys = np.zeros(size, np.int32), np.empty(len(points), np.int64)
    sums, patch_of = np.empty((len(points), 10)), np.zeros(len(points), np.int64)
    count, patches, number, last, last_patch = 0, 0, 0, -1, -1  # neighbours are often in the same cell
    for p in range(len(points)):
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        key = _key(x * per_patch, y * per_patch, z * per_patch)
        if key != last_patch:
            last_patch, number = key, _number_of(key, of_patch, patch_keys, patches)
            if number == patches:
                sums[number] = 0.0
                patches += 1
        sums[number, 0] += 1
        sums[number, 1] += x
        sums[number, 2] += y
        sums[number, 3] += z
        sums[number, 4] += x * x
        sums[number, 5] += x * y
        sums[number, 6] += x * z
        sums[number, 7] += y * y
        sums[number, 8] += y * z
        sums[number, 9] += z * z
        if not nearest * nearest <= x * x + y * y + z * z <= farthest * farthest:
            continue
        key = _key(x * per_side, y * per_side, z * per_side)
        if key != last and _number_of(key, table, keys, count) == count:
            chosen[count], patch_of[count] = p, number
            count += 1
        last = key
    return chosen[:count], patch_of[:count], sums[:patches]


@compiled
def _key(x: float, y: float, z: float) -> int:
    """The key of the cell of side 1 that holds a point."""
    return key_of((int(x + HALF), int(y + HALF), int(z + HALF)), len(SIDES) - 1)


@compiled
def _number_of(key: int, table: Ints32, keys: Ints, count: int) -> int:
    """The number of a cell; `count`, that of the known cells, for a new one, which is then known by the `keys` of all
    cells and the hash `table` of their numbers plus one."""
    mask = len(table) - 1
    place = ((key * 0x9E3779B97F4A7C1) >> 21) & mask
    while table[place] > 0:
        if keys[table[place] - 1] == key:
            return int(table[place] - 1)
        place = (place + 1) & mask
    table[place], keys[count] = count + 1, key
    return count


@compiled
def _normals(patches: Floats) -> Floats:
    """(P, 3) unit normals, of either sign, of the surfaces that patches (P, 10) of a scan's points show; zero where
    these are few, or not on one plane."""
    normals = np.zeros((len(patches), 3))
    for p in range(len(patches)):
        n = patches[p, 0]
        if n >= _LEAST:
            x, y, z = patches[p, 1] / n, patches[p, 2] / n, patches[p, 3] / n
            values, normal, _ = principal_axes(
                patches[p, 4] / n - x * x, patches[p, 5] / n - x * y, patches[p, 6] / n - x * z,
                patches[p, 7] / n - y * y, patches[p, 8] / n - y * z, patches[p, 9] / n - z * z,
            )  # fmt: skip
            if values[1] > _FLAT * max(values[0], SENSOR.range_noise**2):
                normals[p, 0], normals[p, 1], normals[p, 2] = normal
    return normals


def pose_at(motion: Motion, second: float) -> Floats:
    """(4, 4) the pose at any time, beyond both ends by the motion there."""
    if len(motion.knots) == 1:
        return motion.knots[0].copy()
    k = int(np.clip(np.searchsorted(motion.seconds, second, side="right") - 1, 0, len(motion.knots) - 2))
    return np.asarray(moved_on(motion.knots[k], velocity_after(motion, k), second - motion.seconds[k]))


def velocity_after(motion: Motion, knot: int) -> Floats:
    """(6,) the velocity from a knot to the next one: rotation vector and translation, axes of `odom`, a second."""
    seconds = motion.seconds[knot + 1] - motion.seconds[knot]
    return np.asarray(velocity_between(motion.knots[knot], motion.knots[knot + 1], seconds))


def deskewed(found: Registration, points: Floats) -> Floats:
    """The points (N, 3) of a scan as the sensor would have measured them at its stamp."""
    if found.point_times is None:
        return points
    steady = points if found.unsteady is None else steadied(found.unsteady, points, found.point_times)
    return _at_stamp(found, steady, found.point_times)


def few_points(found: Registration, points: Floats, settings: TrackingSettings) -> Floats:
    """A few of the points (N, 3) of a scan, spread evenly in space, as `deskewed` does: those that were registered."""
    few = found.used or thinned(points, found.point_times, 0.0, _SIDE, settings)[0]
    return _at_stamp(found, few.points, few.seconds)


def _at_stamp(found: Registration, steady: Floats, seconds: Floats) -> Floats:
    in_odom = placed(steady, seconds, found.motion.seconds, found.motion.knots)[0]
    return transform_points(inverse(found.T_odom_sensor), in_odom)


def motion_from_stamp(found: Registration) -> Motion:
    """The motion during a scan in the sensor's frame at its stamp: that by which `deskewed` places the points."""
    return replace(found.motion, knots=inverse(found.T_odom_sensor) @ found.motion.knots)


def pose_of_points(scan: TimedPoints, placed_by: Motion, motion: Motion) -> Floats:
    """(4, 4) where a scan's points, which `placed_by` put into one frame, lie as one body by another motion: the mean
    over the times at which they were measured."""
    shares = [float(np.interp(scan.seconds, scan.knot_seconds, knot).mean()) for knot in np.eye(len(scan.knot_seconds))]
    each = np.stack([pose_at(motion, t) @ inverse(pose_at(placed_by, t)) for t in scan.knot_seconds])
    T = np.tensordot(shares, each, 1)
    T[:3, :3] = Rotation.from_matrix(each[:, :3, :3]).mean(shares).as_matrix()
    return T
