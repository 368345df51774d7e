"""Small symmetric linear systems in compiled functions, where linking LAPACK would take seconds to compile."""

import math

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled

Floats = NDArray[np.float64]


@compiled
def solved(H: Floats, g: Floats) -> Floats:
    """x (n,) with H x = g for a positive definite H (n, n), by Cholesky factorisation."""
    L, x = np.zeros_like(H), g.copy()
    for i in range(len(g)):
        for j in range(i + 1):
            rest = H[i, j]
            for k in range(j):
                rest -= L[i, k] * L[j, k]
            L[i, j] = math.sqrt(rest) if i == j else rest / L[j, j]
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
