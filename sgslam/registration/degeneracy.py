"""Directions that no surface constrains: information that errors of the normals feign is taken out."""

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from sgslam.geometry.normal_equations import eigen3

Floats = NDArray[np.float64]


@compiled
def project_out_feigned(H: Floats, g: Floats, F: Floats, chance: float) -> None:
    """Takes the information about translations that errors of the normals may feign out of the normal equations.

    F (3, 3) is what errors of the normals contribute by expectation; so many times as much, `chance`, is taken from the
    information along each principal direction, and all that there is where it is less. (A soft form of the solution
    remapping of Zhang, Kaess, Singh, ICRA 2016: nothing toggles between scans.)
    """
    M, n = np.zeros((3, 3)), len(g) // 6
    own = np.empty((n, n))
    for k in range(n):
        for m in range(n):
            for i in range(3):
                for j in range(3):
                    M[i, j] += H[6 * k + 3 + i, 6 * m + 3 + j]
    values, axes = eigen3(M)
    for a in range(3):
        e, feigned = axes[:, a], 0.0
        for i in range(3):
            for j in range(3):
                feigned += e[i] * F[i, j] * e[j]
        kept = max(1 - chance * feigned / max(values[a], 1e-300), 0.0)
        for k in range(n):
            for m in range(n):
                own[k, m] = 0.0
                for i in range(3):
                    for j in range(3):
                        own[k, m] += e[i] * H[6 * k + 3 + i, 6 * m + 3 + j] * e[j]
        for k in range(n):
            along = 0.0
            for i in range(3):
                along += g[6 * k + 3 + i] * e[i]
            for i in range(3):
                g[6 * k + 3 + i] -= (1 - kept) * along * e[i]
        for k in range(n):
            for c in range(6 * n):
                along = 0.0
                for i in range(3):
                    along += H[6 * k + 3 + i, c] * e[i]
                for i in range(3):
                    H[6 * k + 3 + i, c] -= (1 - kept) * along * e[i]
            for c in range(6 * n):
                along = 0.0
                for i in range(3):
                    along += H[c, 6 * k + 3 + i] * e[i]
                for i in range(3):
                    H[c, 6 * k + 3 + i] -= (1 - kept) * along * e[i]
        for k in range(n):
            for m in range(n):
                for i in range(3):
                    for j in range(3):
                        H[6 * k + 3 + i, 6 * m + 3 + j] += kept * (1 - kept) * own[k, m] * e[i] * e[j]
