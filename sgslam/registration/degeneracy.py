"""Directions that no surface constrains: information that errors of the normals feign is taken out."""

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled

Floats = NDArray[np.float64]
_SMALL = 1e-9  # of the largest information, what is added to each direction: a matrix of less rank has no inverse


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
            M[i, i] += _SMALL * most
    return M
