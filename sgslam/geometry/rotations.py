"""Rotation vectors, compiled."""

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
