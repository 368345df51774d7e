"""Normal equations of points of a moving sensor against the planes of a surfel map."""

import math

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from sgslam.registration.surfel_map import (
    Surfels,
    add_normal_variance,
    misfit,
    nearest_plane,
    plane_residual,
    typical_variance,
)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@compiled
def turn_between(T_a: Floats, T_b: Floats) -> Floats:
    """(3,) the rotation vector, of less than pi, from one pose (4, 4) to another, in axes of `odom`."""
    D, v = np.zeros((3, 3)), np.empty(3)
    for i in range(3):
        for j in range(3):
            for k in range(3):
                D[i, j] += T_b[i, k] * T_a[j, k]
    v[0], v[1], v[2] = (D[2, 1] - D[1, 2]) / 2, (D[0, 2] - D[2, 0]) / 2, (D[1, 0] - D[0, 1]) / 2
    sine = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    if sine > 1e-9:
        v *= math.atan2(sine, (D[0, 0] + D[1, 1] + D[2, 2] - 1) / 2) / sine
    return v


@compiled
def rotated_by(w: Floats, share: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A point rotated by a share of a rotation vector (3,), by Rodrigues' formula."""
    angle = math.sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2])
    if angle < 1e-12:
        return x, y, z
    ax, ay, az = w[0] / angle, w[1] / angle, w[2] / angle
    c, s = math.cos(share * angle), math.sin(share * angle)
    along = (ax * x + ay * y + az * z) * (1 - c)
    return (
        x * c + (ay * z - az * y) * s + ax * along,
        y * c + (az * x - ax * z) * s + ay * along,
        z * c + (ax * y - ay * x) * s + az * along,
    )


@compiled
def placed(points: Floats, knot: Ints, share: Floats, knots: Floats) -> tuple[Floats, Floats]:
    """Points (N, 3) and their unit rays (N, 3) in `odom`.

    Each point was measured by a sensor that had moved a `share` of the way from knot to next knot; `knots` (K, 4, 4)
    are its poses there.
    """
    turns = np.empty((len(knots), 3))
    for k in range(len(knots) - 1):
        turns[k] = turn_between(knots[k], knots[k + 1])
    moved, rays = np.empty((len(points), 3)), np.empty((len(points), 3))
    for p in range(len(points)):
        k = knot[p]
        _place(points[p], k, share[p], knots, turns, moved[p], rays[p])
    return moved, rays


@compiled
def _place(point: Floats, k: int, share: float, knots: Floats, turns: Floats, moved: Floats, ray: Floats) -> None:
    T = knots[k]
    x = T[0, 0] * point[0] + T[0, 1] * point[1] + T[0, 2] * point[2]
    y = T[1, 0] * point[0] + T[1, 1] * point[1] + T[1, 2] * point[2]
    z = T[2, 0] * point[0] + T[2, 1] * point[1] + T[2, 2] * point[2]
    if share != 0.0:
        x, y, z = rotated_by(turns[k], share, x, y, z)
    far = 1 / math.sqrt(x * x + y * y + z * z)
    ray[0], ray[1], ray[2] = x * far, y * far, z * far
    for i in range(3):
        moved[i] = T[i, 3]
        if share != 0.0:
            moved[i] += share * (knots[k + 1, i, 3] - T[i, 3])
    moved[0] += x
    moved[1] += y
    moved[2] += z


@compiled
def find_planes(
    points: Floats, knot: Ints, share: Floats, knots: Floats, surfels: Surfels, oldest: float, gate: float,
    error: float, moved: Floats, plane_of: Ints,
) -> None:  # fmt: skip
    """Fills in where points (N, 6) are in `odom`, `moved` (N, 3), and the plane (N,) of each, -1 for none.

    A plane is within `gate` (m) of its point, whose place is known to an `error` (m).
    """
    turns, ray, normal, sensor = np.empty((len(knots), 3)), np.empty(3), np.empty(3), np.empty(3)
    for k in range(len(knots) - 1):
        turns[k] = turn_between(knots[k], knots[k + 1])
    for p in range(len(points)):
        _place(points[p], knot[p], share[p], knots, turns, moved[p], ray)
        T, q = knots[knot[p]], points[p]
        for i in range(3):
            normal[i] = T[i, 0] * q[3] + T[i, 1] * q[4] + T[i, 2] * q[5]
            sensor[i] = T[i, 3]
            if share[p] != 0.0:
                sensor[i] += share[p] * (knots[knot[p] + 1, i, 3] - T[i, 3])
        plane_of[p] = nearest_plane(moved[p], sensor, normal, gate, error, surfels, oldest)


@compiled
def _grouped(moved: Floats, plane_of: Ints, planes: Floats) -> tuple[Floats, Ints, Floats]:
    """The distance (N,) of points (N, 3) from their planes, the group (N,) of all points on the same plane, and the
    scatter (G,), m2, of each group's distances."""
    off_of, group_of = np.empty(len(moved)), np.full(len(moved), -1)
    group, sums, count = np.full(len(planes), -1), np.zeros((len(moved), 3)), 0
    for p in range(len(moved)):
        s = plane_of[p]
        if s < 0:
            continue
        if group[s] < 0:
            group[s] = count
            count += 1
        off, _ = plane_residual(moved[p, 0], moved[p, 1], moved[p, 2], planes[s])
        group_of[p], off_of[p] = group[s], off
        own = sums[group[s]]
        own[0] += 1
        own[1] += off
        own[2] += off * off
    mean = sums[:count, 1] / sums[:count, 0]
    return off_of, group_of, np.maximum(sums[:count, 2] / sums[:count, 0] - mean * mean, 0.0)


@compiled
def _weighed(
    moved: Floats, plane_of: Ints, off_of: Floats, group_of: Ints, scatter: Floats, planes: Floats, kernel: float,
    variance: float, is_placed: bool,
) -> Floats:  # fmt: skip
    """The weight (N,) of each point (N, 3), zero for one without a plane; see `add_points`."""
    weights, shared = np.zeros(len(moved)), np.zeros(len(scatter))
    flat = typical_variance(planes, plane_of)
    for p in range(len(moved)):
        s, own = plane_of[p], group_of[p]
        if s < 0:
            continue
        off, spread = plane_residual(moved[p, 0], moved[p, 1], moved[p, 2], planes[s])
        scale = kernel * kernel + spread
        robust = scale / (scale + off * off + scatter[own])
        weights[p] = robust * robust / (variance + spread)
        shared[own] += weights[p] * misfit(planes[s], flat)
    if is_placed:
        for p in range(len(moved)):
            if plane_of[p] >= 0:
                weights[p] /= 1 + shared[group_of[p]]
    return weights


@compiled
def _add_blocks(own: Floats, joint: Floats, pull: Floats, H: Floats, g: Floats) -> None:
    """Adds the blocks of each knot (K, 6, 6), (K, 6), and between it and the next one, to H (6K, 6K), g (6K,)."""
    for k in range(len(pull)):
        for i in range(6):
            g[6 * k + i] += pull[k, i]
            for j in range(6):
                low, high = min(i, j), max(i, j)
                H[6 * k + i, 6 * k + j] += own[k, low, high]
                if k + 1 < len(pull):
                    H[6 * k + i, 6 * k + 6 + j] += joint[k, low, high]
                    H[6 * k + 6 + i, 6 * k + j] += joint[k, low, high]


@compiled
def add_points(
    moved: Floats, plane_of: Ints, knot: Ints, share: Floats, knots: Floats, planes: Floats, error: float,
    kernel: float, variance: float, near: float, newest: int, H: Floats, g: Floats, F: Floats,
) -> tuple[float, int, int]:  # fmt: skip
    """Adds all points to normal equations H (6K, 6K), g (6K,) of K knots; rotation first, both in axes of `odom`.

    A point, its place known to an `error` (m), counts by the variance (m2) of its distance from its plane and by the
    plane's, times the weight of Geman and McClure with scale `kernel` (m), where the scatter of all points on the same
    plane counts as a residual: a wall's points near a known floor do not agree about it. Once they are near
    their places, all points on a plane that is not flat share one error, its misfit: where a cell holds parts of two
    surfaces, the plane between them is none. The upper triangle of F (6, 6) gets the information that errors of the
    normals feign. Returns the median distance (m) of the points from their planes; of those from the `newest` one on,
    the numbers of points with a plane, and of those `near` (m) it.
    """
    off_of, group_of, scatter = _grouped(moved, plane_of, planes)
    is_placed = 2 * error < kernel
    weights = _weighed(moved, plane_of, off_of, group_of, scatter, planes, kernel, variance, is_placed)
    # blocks of H: of a knot, and between it and the next one
    own, joint, pull = np.zeros((len(knots), 6, 6)), np.zeros((len(knots), 6, 6)), np.zeros((len(knots), 6))
    used, found, close, offs, J, D = 0, 0, 0, np.empty(len(moved)), np.empty(6), np.empty(6)
    for p in range(len(moved)):
        s, k, a, off, weight = plane_of[p], knot[p], share[p], off_of[p], weights[p]
        if s < 0:
            continue
        offs[used] = abs(off)
        used += 1
        if p >= newest:
            found += 1
            close += abs(off) < near
        nx, ny, nz = planes[s, 0], planes[s, 1], planes[s, 2]
        x = moved[p, 0] - knots[k, 0, 3]
        y = moved[p, 1] - knots[k, 1, 3]
        z = moved[p, 2] - knots[k, 2, 3]
        if a != 0.0:
            x -= a * (knots[k + 1, 0, 3] - knots[k, 0, 3])
            y -= a * (knots[k + 1, 1, 3] - knots[k, 1, 3])
            z -= a * (knots[k + 1, 2, 3] - knots[k, 2, 3])
        J[0], J[1], J[2] = y * nz - z * ny, z * nx - x * nz, x * ny - y * nx
        J[3], J[4], J[5] = nx, ny, nz
        add_normal_variance(planes[s], x, y, z, weight, D, F)
        b = 1 - a
        for i in range(6):
            wi = weight * J[i]
            pull[k, i] += b * wi * off
            for j in range(i, 6):
                own[k, i, j] += b * b * wi * J[j]
            if a != 0.0:
                pull[k + 1, i] += a * wi * off
                for j in range(i, 6):
                    own[k + 1, i, j] += a * a * wi * J[j]
                    joint[k, i, j] += a * b * wi * J[j]
    _add_blocks(own, joint, pull, H, g)
    return float(np.median(offs[:used])) if used else math.inf, found, close
