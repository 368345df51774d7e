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


@compiled
def elimination(edges: Index, count: int) -> Elimination:
    """Returns the elimination for distinct edges (E, 2) between `count` nodes."""
    joined, left = np.zeros((count, count), dtype=np.bool_), np.ones(count, dtype=np.bool_)
    for e in range(len(edges)):
        joined[edges[e, 0], edges[e, 1]] = joined[edges[e, 1], edges[e, 0]] = True
    order = np.empty(count, dtype=np.int64)
    for n in range(count):
        g = np.array([(joined[h] & left).sum() if left[h] else count for h in range(count)]).argmin()
        order[n], left[g] = g, False
        near = np.flatnonzero(joined[g] & left)
        for k in near:
            for j in near:
                joined[k, j] = joined[k, j] or j != k
    first, block = np.zeros(count + 1, dtype=np.int64), np.full((count, count), -1)
    later = np.empty(joined.sum() // 2, dtype=np.int64)
    for n in range(count):
        first[n + 1] = first[n]
        for m in range(n + 1, count):
            if joined[order[n], order[m]]:
                later[first[n + 1]] = order[m]
                block[order[n], order[m]] = block[order[m], order[n]] = first[n + 1]
                first[n + 1] += 1
    of_edge, turned = np.empty(len(edges), dtype=np.int64), np.zeros(len(edges), dtype=np.bool_)
    for e in range(len(edges)):
        of_edge[e] = block[edges[e, 0], edges[e, 1]]
        turned[e] = later[of_edge[e]] == edges[e, 1]
    return Elimination(order, first, later, block, of_edge, turned)


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
