"""The rigid motion of the plane that brings points nearest to lines: point-to-line least squares (Gauss-Newton)."""

import numpy as np

from data.geometry import se2
from data.geometry.se2 import Array

STEPS = 6
HOLD = 1e-2  # how much the start counts, where the lines leave a direction open


def fit_to_lines(points: Array, foot: Array, normal: Array, start: Array) -> Array:
    """(3,) T_out_in that brings the (N, 2) points nearest to lines through `foot` (N, 2) with unit `normal` (N, 2).

    `start` (3,) must be near (30 degrees) and decides what the lines leave open: few or parallel ones, or none.
    """
    T = np.asarray(start, dtype=float)
    if not len(points):
        return T
    middle = points.mean(axis=0)  # the turn is about it, so that far coordinates do no harm
    yaw, at = float(T[0]), se2.apply(T, middle)
    for _ in range(STEPS):
        arm = se2.rotate(yaw, points - middle)
        rows = np.column_stack((normal[:, 1] * arm[:, 0] - normal[:, 0] * arm[:, 1], normal))
        off = np.einsum("ij,ij->i", foot - at - arm, normal)
        step = np.linalg.solve(rows.T @ rows + HOLD**2 * np.eye(3), rows.T @ off)
        yaw, at = yaw + float(step[0]), at + step[1:]
    return np.array([se2.wrap(np.array(yaw)), *(at - se2.rotate(yaw, middle))])
