"""Normal equations of points of a moving sensor against the planes of a surfel map."""

import math

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from sgslam.surfels.planes import (
    add_normal_variance,
    misfit,
    plane_residual,
    typical_variance,
)

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


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
        off, _ = plane_residual(moved[p, 0], moved[p, 1], moved[p, 2], planes, s)
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
        off, spread = plane_residual(moved[p, 0], moved[p, 1], moved[p, 2], planes, s)
        scale = kernel * kernel + spread
        robust = scale / (scale + off * off + scatter[own])
        weights[p] = robust * robust / (variance + spread)
        shared[own] += weights[p] * misfit(planes, s, flat)
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
        add_normal_variance(planes, s, x, y, z, weight, D, F)
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
