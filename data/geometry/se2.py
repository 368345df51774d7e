"""Proper motions of the plane: (..., 3) arrays of (yaw, x, y), p_a = R(yaw) p_b + (x, y) for T_a_b."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_STEPS = 6
_HOLD = 1e-2  # how much the start counts, where the lines leave a direction open


def wrap(angle: Array) -> Array:
    """Angles to [-pi, pi)."""
    return angle - 2 * np.pi * np.floor((angle + np.pi) / (2 * np.pi))  # several times faster than a remainder


def rotate(yaw: Array | float, points: Array) -> Array:
    """(..., 2) points turned by yaw; yaw broadcasts against the points' leading axes."""
    c, s = np.cos(yaw), np.sin(yaw)
    x, y = points[..., 0], points[..., 1]
    turned = c * x - s * y
    both = np.empty((*turned.shape, 2))  # numpy's stack takes longer than the rest of it, for few points
    both[..., 0], both[..., 1] = turned, s * x + c * y
    return both


def apply(T_a_b: Array, points_b: Array) -> Array:
    """(..., 2) points in a; the motion's leading axes broadcast against the points'."""
    return rotate(T_a_b[..., 0], points_b) + T_a_b[..., 1:]


def compose(T_a_b: Array, T_b_c: Array) -> Array:
    """T_a_c."""
    yaw = wrap(T_a_b[..., 0] + T_b_c[..., 0])
    return np.concatenate((yaw[..., None], apply(T_a_b, T_b_c[..., 1:])), axis=-1)


def to_se3(T_a_b: Array, z: float = 0.0) -> Array:
    """(4, 4) the motion (3,) of the plane as one of space, raised by z (m)."""
    T = np.eye(4)
    T[:2, :2] = rotate(float(T_a_b[0]), np.eye(2)).T
    T[:3, 3] = (T_a_b[1], T_a_b[2], z)
    return T


def inverse(T_a_b: Array) -> Array:
    """T_b_a."""
    return np.concatenate((-T_a_b[..., :1], rotate(-T_a_b[..., 0], -T_a_b[..., 1:])), axis=-1)


def fit_to_lines(points: Array, foot: Array, normal: Array, start: Array) -> Array:
    """(3,) T_out_in that brings the (N, 2) points nearest to lines through `foot` (N, 2) with unit `normal` (N, 2):
    point-to-line least squares (Gauss-Newton).

    `start` (3,) must be near (30 degrees) and decides what the lines leave open: few or parallel ones, or none.
    """
    T = np.asarray(start, dtype=float)
    if not len(points):
        return T
    middle = points.mean(axis=0)  # the turn is about it, so that far coordinates do no harm
    yaw, at = float(T[0]), apply(T, middle)
    for _ in range(_STEPS):
        arm = rotate(yaw, points - middle)
        rows = np.column_stack((normal[:, 1] * arm[:, 0] - normal[:, 0] * arm[:, 1], normal))
        off = np.einsum("ij,ij->i", foot - at - arm, normal)
        step = np.linalg.solve(rows.T @ rows + _HOLD**2 * np.eye(3), rows.T @ off)
        yaw, at = yaw + float(step[0]), at + step[1:]
    return np.array([wrap(np.array(yaw)), *(at - rotate(yaw, middle))])
