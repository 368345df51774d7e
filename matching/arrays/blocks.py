"""A sparse Cholesky solver for symmetric systems of 3 x 3 blocks, one for each node and each edge of a graph.

Eliminating a node connects its remaining neighbours; the node with the fewest is eliminated first (W. F. Tinney and
J. W. Walker: Direct solutions of sparse network equations by optimally ordered triangular factorization, 1967).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from data.geometry.se2 import Array
from matching.arrays.walls import Index


class Elimination(NamedTuple):
    """The order in which G nodes are eliminated, and the B blocks of each with its remaining neighbours."""

    order: Index  # (G,)
    first: Index  # (G + 1,) where the blocks begin of the node that goes first, second, ...
    later: Index  # (B,) the neighbour, whose row of blocks it is
    block: Index  # (G, G) the block of each two nodes, -1 where there is none
    of_edge: Index  # (E,) the block of each edge
    turned: NDArray[np.bool_]  # (E,) whether it is the row of the edge's second node


def elimination(edges: Index, count: int) -> Elimination:
    """Returns the elimination for distinct edges (E, 2) between `count` nodes."""
    joined, left = np.zeros((count, count), dtype=np.bool_), np.ones(count, dtype=np.bool_)
    joined[edges[:, 0], edges[:, 1]] = joined[edges[:, 1], edges[:, 0]] = True
    order = np.empty(count, dtype=np.int64)
    for n in range(count):
        g = np.where(left, (joined & left).sum(axis=1), count).argmin()
        order[n], left[g] = g, False
        near = np.flatnonzero(joined[g] & left)
        joined[np.ix_(near, near)] = True
        joined[near, near] = False
    earlier, later = np.nonzero(np.triu(joined[np.ix_(order, order)]))
    first, block = np.zeros(count + 1, dtype=np.int64), np.full((count, count), -1)
    first[1:] = np.cumsum(np.bincount(earlier, minlength=count))
    earlier, later = order[earlier], order[later]
    block[earlier, later] = block[later, earlier] = np.arange(len(later))
    of_edge = block[edges[:, 0], edges[:, 1]]
    return Elimination(order, first, later, block, of_edge, later[of_edge] == edges[:, 1])


@compiled
def solve(e: Elimination, own: Array, between: Array, x: Array) -> None:
    """Solves a positive definite system; the solution overwrites the right side (G, 3).

    `own` (G, 3, 3) are the diagonal blocks, of which the lower triangle is read, `between` (B, 3, 3) the others; both
    are overwritten.
    """
    order, first, later = e.order, e.first, e.later
    for n in range(len(order)):
        g = order[n]
        _factored(own, g)
        _lowered(own, g, x, g)
        for k in range(first[n], first[n + 1]):
            h, block = later[k], between[k]
            for r in range(3):
                _lowered(own, g, block, r)
                x[h, r] -= block[r, 0] * x[g, 0] + block[r, 1] * x[g, 1] + block[r, 2] * x[g, 2]
            for j in range(first[n], k + 1):
                into, other = own[h] if j == k else between[e.block[h, later[j]]], between[j]
                for r in range(3):
                    for c in range(3):
                        into[r, c] -= block[r, 0] * other[c, 0] + block[r, 1] * other[c, 1] + block[r, 2] * other[c, 2]
    for n in range(len(order) - 1, -1, -1):
        g = order[n]
        for k in range(first[n], first[n + 1]):
            h = later[k]
            for c in range(3):
                x[g, c] -= between[k, 0, c] * x[h, 0] + between[k, 1, c] * x[h, 1] + between[k, 2, c] * x[h, 2]
        x[g, 2] /= own[g, 2, 2]
        x[g, 1] = (x[g, 1] - own[g, 2, 1] * x[g, 2]) / own[g, 1, 1]
        x[g, 0] = (x[g, 0] - own[g, 1, 0] * x[g, 1] - own[g, 2, 0] * x[g, 2]) / own[g, 0, 0]


@compiled
def _factored(A: Array, g: int) -> None:
    """Overwrites the lower triangle of one of (G, 3, 3) with its Cholesky factor."""
    A[g, 0, 0] = np.sqrt(A[g, 0, 0])
    A[g, 1, 0] /= A[g, 0, 0]
    A[g, 2, 0] /= A[g, 0, 0]
    A[g, 1, 1] = np.sqrt(A[g, 1, 1] - A[g, 1, 0] ** 2)
    A[g, 2, 1] = (A[g, 2, 1] - A[g, 2, 0] * A[g, 1, 0]) / A[g, 1, 1]
    A[g, 2, 2] = np.sqrt(A[g, 2, 2] - A[g, 2, 0] ** 2 - A[g, 2, 1] ** 2)


@compiled
def _lowered(L: Array, g: int, b: Array, r: int) -> None:
    """Solves a lower triangular system, one of (G, 3, 3), for a row of right sides (R, 3), in place."""
    b[r, 0] /= L[g, 0, 0]
    b[r, 1] = (b[r, 1] - L[g, 1, 0] * b[r, 0]) / L[g, 1, 1]
    b[r, 2] = (b[r, 2] - L[g, 2, 0] * b[r, 0] - L[g, 2, 1] * b[r, 1]) / L[g, 2, 2]
