"""Rotations, and small symmetric linear systems, in compiled functions."""

import math

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled

Floats = NDArray[np.float64]
_SMALL = 0.25  # rad2: the series of a smaller angle are as true as the functions


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
def rotated_by(wx: float, wy: float, wz: float, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A point rotated by a rotation vector, by Rodrigues' formula; for small angles by its series,
    without roots and trigonometry, to 1e-14."""
    t = wx * wx + wy * wy + wz * wz
    if t < _SMALL:
        first = 1 - t * (1 / 6) * (1 - t * (1 / 20) * (1 - t * (1 / 42) * (1 - t * (1 / 72) * (1 - t * (1 / 110)))))
        second = 0.5 - t * (1 / 24) * (1 - t * (1 / 30) * (1 - t * (1 / 56) * (1 - t * (1 / 90) * (1 - t * (1 / 132)))))
    else:
        angle = math.sqrt(t)
        first, second = math.sin(angle) / angle, (1 - math.cos(angle)) / t
    cx, cy, cz = wy * z - wz * y, wz * x - wx * z, wx * y - wy * x
    return (
        x + first * cx + second * (wy * cz - wz * cy),
        y + first * cy + second * (wz * cx - wx * cz),
        z + first * cz + second * (wx * cy - wy * cx),
    )


@compiled
def solved(H: Floats, g: Floats) -> Floats:
    """x (n,) with H x = g for a positive definite H (n, n), by Cholesky factorisation."""
    L, x = np.linalg.cholesky(H), g.copy()
    for i in range(len(g)):
        for k in range(i):
            x[i] -= L[i, k] * x[k]
        x[i] /= L[i, i]
    for i in range(len(g) - 1, -1, -1):
        for k in range(i + 1, len(g)):
            x[i] -= L[k, i] * x[k]
        x[i] /= L[i, i]
    return x


@compiled
def add_row(H: Floats, g: Floats, J: Floats, off: float, weight: float) -> None:
    """Adds a measurement with residual `off` and Jacobian J (n,) to normal equations H (n, n), g (n,), in place."""
    for a in range(len(J)):
        g[a] += weight * off * J[a]
        for b in range(len(J)):
            H[a, b] += weight * J[a] * J[b]


@compiled
def square_up(T: Floats) -> None:
    """Makes the rotation of a pose (4, 4) orthogonal again after rounding errors, in place, by one Newton step."""
    R = T[:3, :3].copy()
    for i in range(3):
        for j in range(3):
            T[i, j] = 1.5 * R[i, j]
            for k in range(3):
                square = R[0, k] * R[0, j] + R[1, k] * R[1, j] + R[2, k] * R[2, j]
                T[i, j] -= 0.5 * R[i, k] * square


@compiled
def principal_axes(
    xx: float, xy: float, xz: float, yy: float, yz: float, zz: float
) -> tuple[tuple[float, float, float], tuple[float, float, float], tuple[float, float, float]]:
    """The eigenvalues, ascending, of a covariance (3, 3), and the unit eigenvectors of the first two of them.

    In closed form (Smith, CACM 1961), made for flat ones: the other two follow in the plane of the first vector.
    """
    mean = (xx + yy + zz) / 3
    a, b, c = xx - mean, yy - mean, zz - mean
    spread = math.sqrt((a * a + b * b + c * c + 2 * (xy * xy + xz * xz + yz * yz)) / 6)
    if spread > 0:
        determinant = a * (b * c - yz * yz) - xy * (xy * c - yz * xz) + xz * (xy * yz - b * xz)
        angle = math.acos(min(max(determinant / (2 * spread**3), -1.0), 1.0)) / 3
        least = 2 * spread * math.cos(angle + 2 * math.pi / 3)
        a, b, c = a - least, b - least, c - least
    # the first eigenvector is normal to all rows that remain: the longest of their cross products
    n, size = (0.0, 0.0, 1.0), 0.0
    for own in (
        (xy * yz - xz * b, xz * xy - a * yz, a * b - xy * xy),
        (xy * c - xz * yz, xz * xz - a * c, a * yz - xy * xz),
        (b * c - yz * yz, yz * xz - xy * c, xy * yz - b * xz),
    ):
        square = own[0] * own[0] + own[1] * own[1] + own[2] * own[2]
        if square > size:
            n, size = own, square
    if size > 0:
        length = math.sqrt(size)
        n = (n[0] / length, n[1] / length, n[2] / length)
    # two directions u and v normal to it, and the axes of the covariance between them
    ux, uy, uz = (-n[1], n[0], 0.0) if abs(n[2]) < 0.9 else (0.0, -n[2], n[1])
    length = math.sqrt(ux * ux + uy * uy + uz * uz)
    ux, uy, uz = ux / length, uy / length, uz / length
    vx, vy, vz = n[1] * uz - n[2] * uy, n[2] * ux - n[0] * uz, n[0] * uy - n[1] * ux
    uu = xx * ux * ux + yy * uy * uy + zz * uz * uz + 2 * (xy * ux * uy + xz * ux * uz + yz * uy * uz)
    vv = xx * vx * vx + yy * vy * vy + zz * vz * vz + 2 * (xy * vx * vy + xz * vx * vz + yz * vy * vz)
    uv = ux * (xx * vx + xy * vy + xz * vz) + uy * (xy * vx + yy * vy + yz * vz) + uz * (xz * vx + yz * vy + zz * vz)
    half, middle = math.hypot((uu - vv) / 2, uv), (uu + vv) / 2
    turn = math.atan2(2 * uv, uu - vv) / 2 + math.pi / 2  # of the lesser one of both
    s, t = math.cos(turn), math.sin(turn)
    values = (max(3 * mean - uu - vv, 0.0), middle - half, middle + half)
    return values, n, (s * ux + t * vx, s * uy + t * vy, s * uz + t * vz)
