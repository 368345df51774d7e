"""Points of a moving sensor: where they are, and their normal equations against the planes of a surfel map."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from sgslam.config import TrackingSettings
from sgslam.geometry.compiled import rotated_by, turn_between
from sgslam.surfels import Surfels
from sgslam.surfels.planes import VALID, add_normal_variance, is_within, misfit, off_plane, variance_at
from sgslam.surfels.search import nearest_plane

Floats = NDArray[np.float64]
Ints32 = NDArray[np.int32]
Vector = tuple[float, float, float]
FIRST_OF_KERNEL = 2.5  # times the kernel, in the first iteration: the prediction errs
CONVERGED = 1e-3  # m and rad, an update below which the registration stops
STRAYED = 5e-3  # m and rad: where knots move by less, fewer than one point in a hundred is on another plane
UNKNOWN = -1  # the plane of a point that was not looked for; 0 is none
KERNEL_OF_RESIDUAL = 5.0  # times the median residual
SIGMA_OF_MEDIAN = 1.48  # times the median residual, the standard deviation of a normal distribution
LEAST_SIGMA_OF_RESIDUAL = 6.0  # times the median residual, the least sigma of a point as it is weighted


class Weights(NamedTuple):
    """The part of `TrackingSettings` that the registration needs, as it names them."""

    gate: float
    kernel: float
    spurious: float
    sway: float
    sway_memory: float

    @staticmethod
    def of(settings: TrackingSettings) -> "Weights":
        """Takes them from the settings."""
        return Weights(*(getattr(settings, name) for name in Weights._fields))


@compiled
def placed(points: Floats, seconds: Floats, at: Floats, knots: Floats) -> tuple[Floats, Floats]:
    """Points (N, 3), measured at `seconds` (N,), and the unit rays (N, 3) to them, in `odom`.

    `knots` (K, 4, 4) are the sensor's poses at times `at` (K,), between which it moves steadily.
    """
    turns, found, rays, k = turns_between(knots), np.empty((len(points), 3)), np.empty((len(points), 3)), 0
    for p in range(len(points)):
        k = knot_before(seconds[p], at, k)
        ray, sensor = _turned_at(points, p, k, _share(seconds[p], at, k), knots, turns)
        length = math.sqrt(ray[0] * ray[0] + ray[1] * ray[1] + ray[2] * ray[2])
        for i in range(3):
            found[p, i], rays[p, i] = sensor[i] + ray[i], ray[i] / length
    return found, rays


@compiled
def turns_between(knots: Floats) -> Floats:
    """(K, 3) the rotation vectors from each of the poses (K, 4, 4) to the next one."""
    turns = np.zeros((len(knots), 3))
    for k in range(len(knots) - 1):
        turn = turn_between(knots[k], knots[k + 1])
        for i in range(3):  # a copy of arrays takes seconds to compile
            turns[k, i] = turn[i]
    return turns


@compiled
def knot_before(second: float, at: Floats, k: int) -> int:
    """The knot, but for the last, before a time; it is looked for from number `k` on, as times hardly jump."""
    while k + 2 < len(at) and second >= at[k + 1]:
        k += 1
    while k > 0 and second < at[k]:
        k -= 1
    return k


@compiled
def _share(second: float, at: Floats, k: int) -> float:
    """The share of the way from knot `k` to the next one."""
    return 0.0 if len(at) == 1 else (second - at[k]) / (at[k + 1] - at[k])


@compiled
def _turned_at(points: Floats, p: int, k: int, share: float, knots: Floats, turns: Floats) -> tuple[Vector, Vector]:
    """The way from the sensor to point `p` of points (N, 3), and the sensor, in `odom`, a `share` of the way after knot
    `k`."""
    turned = _turned(knots, k, points[p, 0], points[p, 1], points[p, 2])
    x, y, z = knots[k, 0, 3], knots[k, 1, 3], knots[k, 2, 3]
    if share == 0.0:
        return turned, (x, y, z)
    x += share * (knots[k + 1, 0, 3] - x)
    y += share * (knots[k + 1, 1, 3] - y)
    z += share * (knots[k + 1, 2, 3] - z)
    turned = rotated_by(share * turns[k, 0], share * turns[k, 1], share * turns[k, 2], *turned)
    return turned, (x, y, z)


@compiled
def _turned(knots: Floats, k: int, x: float, y: float, z: float) -> Vector:
    """A vector in the axes of the sensor at knot `k`, in those of `odom`."""
    return (
        knots[k, 0, 0] * x + knots[k, 0, 1] * y + knots[k, 0, 2] * z,
        knots[k, 1, 0] * x + knots[k, 1, 1] * y + knots[k, 1, 2] * z,
        knots[k, 2, 0] * x + knots[k, 2, 1] * y + knots[k, 2, 2] * z,
    )


@compiled
def point_equations(
    points: Floats, seconds: Floats, at: Floats, knots: Floats, plane_of: Ints32, every: int, surfels: Surfels,
    oldest: float, error: float, widest: float, weights: Weights, H: Floats, g: Floats, F: Floats,
) -> tuple[float, int, int]:  # fmt: skip
    """Fills in the normal equations of a scan's points for its knots (K, 4, 4) at times `at` (K,): the first 6K rows
    and columns of H, and of g; rotation first, both in axes of `odom`.

    Points (N, 6), with the normals that the scan shows, are measured at `seconds` (N,); only one of `every` so many is
    taken, and counts as often. Planes `plane_of` (N,) that are
    unknown, or on which a point is no more, are looked for, where a point's place is known to an `error` (m).

    A point counts by the variance of its distance from its plane and by the plane's, times the weight of Geman and
    McClure, where the scatter of all points on the same plane counts as a residual: a wall's points near a known floor
    do not agree about it. The kernel follows the residuals, from the `widest` (m) to that of the weights: a wide one
    finds the way from a poor prediction, a narrow one rejects outliers. Once points are near their places, all on a
    plane that is not flat share one error, its misfit: where a cell holds parts of two surfaces, the plane between them
    is none.

    The upper triangle of F (6, 6) gets the information that errors of the normals feign. Returns the median distance
    (m) of the points from their planes, the number of points with a plane, and of those near it.
    """
    H[:, :], g[:], F[:, :] = 0.0, 0.0, 0.0
    # where the points are, and their planes
    planes, turns, used, k = surfels.planes, turns_between(knots), 0, 0
    knot, share, plane = np.empty(len(points), np.int32), np.empty(len(points)), np.empty(len(points), np.int32)
    way, off, spread = np.empty((len(points), 3)), np.empty(len(points)), np.empty(len(points))
    for p in range(0, len(points), every):
        if plane_of[p] == 0:
            continue
        k = knot_before(seconds[p], at, k)
        a = _share(seconds[p], at, k)
        ray, sensor = _turned_at(points, p, k, a, knots, turns)
        x, y, z = sensor[0] + ray[0], sensor[1] + ray[1], sensor[2] + ray[2]
        s = plane_of[p]
        if s == UNKNOWN or planes[s, VALID] == 0.0 or not is_within(x, y, z, planes, s, error):
            normal = _turned(knots, k, points[p, 3], points[p, 4], points[p, 5])
            s = nearest_plane((x, y, z), sensor, normal, weights.gate, error, surfels, oldest)
            plane_of[p] = s
            if s == 0:
                continue
        knot[used], share[used], plane[used] = k, a, s
        way[used, 0], way[used, 1], way[used, 2] = ray
        off[used], spread[used] = off_plane(x, y, z, planes, s), variance_at(x, y, z, planes, s)
        used += 1
    if used == 0:
        return math.inf, 0, 0
    residual, weight = _weighed(plane[:used], off[:used], spread[:used], planes, every, error, widest, weights, way, F)
    _add_points(knot[:used], share, plane, way, off, weight, planes, len(knots), H, g)
    close = 0
    for p in range(used):
        close += abs(off[p]) < weights.kernel
    return residual, used, close


@compiled
def _weighed(
    plane: Ints32, off: Floats, spread: Floats, planes: NDArray[np.float32], every: int, error: float,
    widest: float, weights: Weights, way: Floats, F: Floats,
) -> tuple[float, Floats]:  # fmt: skip
    """The median distance (m), and the weight (N,) of each point; fills in F. See `point_equations`."""
    # the points on each plane: their number, the sum of their distances, of these squared
    group, groups, of_plane = np.empty(len(plane), np.int32), 0, np.zeros(len(planes), np.int32)
    sums = np.zeros((len(plane), 4))
    for p in range(len(plane)):
        s = plane[p]
        if of_plane[s] == 0:
            groups += 1
            of_plane[s] = groups
        group[p] = of_plane[s] - 1
        of = group[p]
        sums[of, 0] += 1
        sums[of, 1] += off[p]
        sums[of, 2] += off[p] * off[p]
    residual = float(np.median(np.abs(off)))
    kernel = min(widest, max(weights.kernel, KERNEL_OF_RESIDUAL * residual))
    sigma = max(weights.kernel, LEAST_SIGMA_OF_RESIDUAL * residual)
    # each point's weight, and the sum of these times the misfit of their plane
    weight = np.empty(len(plane))
    for p in range(len(plane)):
        of, scale = group[p], kernel * kernel + spread[p]
        mean = sums[of, 1] / sums[of, 0]
        robust = scale / (scale + off[p] * off[p] + max(sums[of, 2] / sums[of, 0] - mean * mean, 0.0))
        weight[p] = every * robust * robust / (sigma * sigma + spread[p])
        sums[of, 3] += weight[p] * misfit(planes, plane[p], (SIGMA_OF_MEDIAN * residual) ** 2)
    is_placed = 2 * error < kernel
    moments = np.zeros((groups, 10))
    for p in range(len(plane)):
        if is_placed:
            weight[p] /= 1 + sums[group[p], 3]
        x, y, z = way[p, 0], way[p, 1], way[p, 2]
        w, of = weight[p], group[p]
        wx, wy, wz = w * x, w * y, w * z
        moments[of, 0] += w
        moments[of, 1] += wx
        moments[of, 2] += wy
        moments[of, 3] += wz
        moments[of, 4] += wx * x
        moments[of, 5] += wx * y
        moments[of, 6] += wx * z
        moments[of, 7] += wy * y
        moments[of, 8] += wy * z
        moments[of, 9] += wz * z
    for p in range(len(plane)):
        if of_plane[plane[p]] > 0:
            add_normal_variance(planes, plane[p], moments[group[p]], F)
            of_plane[plane[p]] = 0
    return residual, weight


@compiled
def _add_points(
    knot: Ints32, share: Floats, plane: Ints32, way: Floats, off: Floats, weight: Floats,
    planes: NDArray[np.float32], knots: int, H: Floats, g: Floats,
) -> None:  # fmt: skip
    """Adds weighted points, at distances `off` from their planes, to the normal equations of their knots."""
    pieces = max(knots - 1, 1)
    # of each piece of the motion: the products of the Jacobians, times the shares of both its knots
    blocks, pull = np.zeros((pieces, 3, 6, 6)), np.zeros((pieces, 2, 6))
    for p in range(len(weight)):
        s, k, x, y, z = plane[p], knot[p], way[p, 0], way[p, 1], way[p, 2]
        nx, ny, nz = np.float64(planes[s, 0]), np.float64(planes[s, 1]), np.float64(planes[s, 2])
        J = (y * nz - z * ny, z * nx - x * nz, x * ny - y * nx, nx, ny, nz)
        after, w = share[p], weight[p]
        before = 1 - after
        first, both, second = w * before * before, w * before * after, w * after * after
        pulled_before, pulled_after = w * before * off[p], w * after * off[p]
        for i in range(6):
            pull[k, 0, i] += pulled_before * J[i]
            pull[k, 1, i] += pulled_after * J[i]
            for j in range(i, 6):
                product = J[i] * J[j]
                blocks[k, 0, i, j] += first * product
                blocks[k, 1, i, j] += both * product
                blocks[k, 2, i, j] += second * product
    for k in range(pieces):
        for i in range(6):
            g[6 * k + i] += pull[k, 0, i]
            if k + 1 < knots:
                g[6 * k + 6 + i] += pull[k, 1, i]
            for j in range(6):
                low, high = min(i, j), max(i, j)
                H[6 * k + i, 6 * k + j] += blocks[k, 0, low, high]
                if k + 1 < knots:
                    H[6 * k + i, 6 * k + 6 + j] += blocks[k, 1, low, high]
                    H[6 * k + 6 + i, 6 * k + j] += blocks[k, 1, low, high]
                    H[6 * k + 6 + i, 6 * k + 6 + j] += blocks[k, 2, low, high]


@compiled
def project_out_spurious(H: Floats, g: Floats, F: Floats, chance: float) -> None:
    """Takes information that errors of the normals may feign out of the normal equations H (6K, 6K), g (6K,).

    The upper triangle of F (6, 6) is what errors of the normals contribute by expectation to the information about a
    motion of all knots; so many times as much, `chance`, is taken away along each direction in which the two do not mix
    (the generalised eigenvectors of both), and all that there is where it is less. (A soft form of the solution
    remapping of Zhang, Kaess, Singh, ICRA 2016: nothing toggles between scans.)
    """
    L = np.linalg.cholesky(_of_all_knots(H))
    L_inverse = np.linalg.inv(L)
    ratio, U = np.linalg.eigh(L_inverse @ (F + F.T - np.diag(np.diag(F))) @ L_inverse.T)
    V, V_inverse = L_inverse.T @ U, U.T @ L.T
    kept = np.maximum(1 - chance * ratio, 0.0)
    whole, root = (V * kept) @ V_inverse, (V * np.sqrt(kept)) @ V_inverse
    for k in range(0, len(g), 6):
        part = whole.T @ g[k : k + 6]
        for i in range(6):  # a copy of arrays takes seconds to compile
            g[k + i] = part[i]
        for m in range(0, len(g), 6):
            block = root.T @ np.ascontiguousarray(H[k : k + 6, m : m + 6]) @ root
            for i in range(6):
                for j in range(6):
                    H[k + i, m + j] = block[i, j]


@compiled
def _of_all_knots(H: Floats) -> Floats:
    """(6, 6) the information about a motion of all knots, regular."""
    M = np.zeros((6, 6))
    for row in range(len(H)):
        for column in range(len(H)):
            M[row % 6, column % 6] += H[row, column]
    for half in (0, 3):
        most = max(M[half, half], M[half + 1, half + 1], M[half + 2, half + 2], 1.0)
        for i in range(half, half + 3):
            M[i, i] += 1e-9 * most  # a matrix of less rank has no inverse
    return M
