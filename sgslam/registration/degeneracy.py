"""Directions that no surface constrains: information that errors of the normals feign is taken out."""

import math

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from sgslam.geometry.normal_equations import cholesky, eigen

Floats = NDArray[np.float64]
_SMALL = 1e-9  # of the largest information, what is added to each direction: a matrix of less rank has no inverse


@compiled
def project_out_feigned(H: Floats, g: Floats, F: Floats, chance: float) -> None:
    """Takes information that errors of the normals may feign out of the normal equations H (6K, 6K), g (6K,).

    The upper triangle of F (6, 6) is what errors of the normals contribute by expectation to the information about a
    motion of all knots; so many times as much, `chance`, is taken away along each direction in which the two do not mix
    (the generalised eigenvectors of both), and all that there is where it is less. (A soft form of the solution
    remapping of Zhang, Kaess, Singh, ICRA 2016: nothing toggles between scans.)
    """
    V, inverse, ratio = _directions(_of_all_knots(H), F)
    whole, root = np.zeros((6, 6)), np.zeros((6, 6))  # V K V^-1 and V K^(1/2) V^-1
    for a in range(6):
        kept = max(1 - chance * ratio[a], 0.0)
        for i in range(6):
            for j in range(6):
                whole[i, j] += kept * V[i, a] * inverse[a, j]
                root[i, j] += math.sqrt(kept) * V[i, a] * inverse[a, j]
    for k in range(len(g) // 6):
        own = slice(6 * k, 6 * k + 6)
        g[own] = _product(whole.T, g[own].copy().reshape(6, 1))[:, 0]
        H[own] = _product(root.T, H[own].copy())
    for k in range(len(g) // 6):
        own = slice(6 * k, 6 * k + 6)
        H[:, own] = _product(H[:, own].copy(), root)


@compiled
def _of_all_knots(H: Floats) -> Floats:
    """(6, 6) the information about a motion of all knots, regular."""
    M = np.zeros((6, 6))
    for row in range(len(H)):
        for column in range(len(H)):
            M[row % 6, column % 6] += H[row, column]
    for half in (0, 3):
        most = max(M[half, half], M[half + 1, half + 1], M[half + 2, half + 2], 1e-300)
        for i in range(half, half + 3):
            M[i, i] += _SMALL * most
    return M


@compiled
def _directions(M: Floats, F: Floats) -> tuple[Floats, Floats, Floats]:
    """V (6, 6) whose columns diagonalise M (6, 6) and F (6, 6, its upper triangle), its inverse, and F over M along
    each of them (6,)."""
    L = cholesky(M)
    C = np.empty((6, 6))
    for i in range(6):
        for j in range(i, 6):
            C[i, j] = C[j, i] = F[i, j]
    for _ in range(2):  # L^-1 F L^-T
        for c in range(6):
            for i in range(6):
                for k in range(i):
                    C[i, c] -= L[i, k] * C[k, c]
                C[i, c] /= L[i, i]
        C = C.T.copy()
    ratio, U = eigen(C)
    V, inverse = U.copy(), _product(U.T.copy(), L.T.copy())
    for c in range(6):  # L^-T U
        for i in range(5, -1, -1):
            for k in range(i + 1, 6):
                V[i, c] -= L[k, i] * V[k, c]
            V[i, c] /= L[i, i]
    return V, inverse, ratio


@compiled
def _product(A: Floats, B: Floats) -> Floats:
    C = np.zeros((A.shape[0], B.shape[1]))
    for i in range(A.shape[0]):
        for k in range(A.shape[1]):
            for j in range(B.shape[1]):
                C[i, j] += A[i, k] * B[k, j]
    return C
