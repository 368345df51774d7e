"""Symmetric systems of 3 x 3 blocks, one for each node of a graph and each of its edges, as band matrices.

Nodes are renumbered (E. Cuthill and J. McKee: Reducing the bandwidth of sparse symmetric matrices, 1969), so that
neighbours lie close; Cholesky's factors of a band matrix stay within the band. A map of hundreds of rooms costs what
its width in rooms asks for.
"""

from dataclasses import dataclass

import numpy as np

from data.compiled import compiled
from matching.se2 import Array
from matching.walls import Index


@dataclass(frozen=True)
class Band:
    """Where the blocks of G nodes and E edges stand in the lower band."""

    place: Index  # (G,) of each node in the new order
    edges: Index  # (E, 2)
    width: int  # of the band, the diagonal included

    @staticmethod
    def of(edges: Index, count: int) -> "Band":
        """For edges (E, 2) between `count` nodes, none of them twice."""
        from scipy.sparse import csr_array  # slow to import
        from scipy.sparse.csgraph import reverse_cuthill_mckee

        ends = np.concatenate((edges, edges[:, ::-1]))
        graph = csr_array((np.ones(len(ends), dtype=np.int8), (ends[:, 0], ends[:, 1])), shape=(count, count))
        place = np.empty(count, dtype=np.int64)
        place[reverse_cuthill_mckee(graph, symmetric_mode=True)] = np.arange(count)
        apart = np.abs(place[edges[:, 0]] - place[edges[:, 1]]).max(initial=0)
        return Band(place, np.ascontiguousarray(edges), 3 * int(apart) + 3)

    def solved(self, own: Array, between: Array, right: Array) -> Array:
        """(K, G, 3) solutions of K systems, which must be positive definite.

        `own` (K, G, 3, 3) on the diagonal, of which the lower triangle is read, `between` (K, E, 3, 3) at (node 0,
        node 1) of each edge, and `right` (K, G, 3).
        """
        from scipy.linalg import lapack  # slow to import

        band, ordered = _ordered(self.place, self.edges, self.width, own, between, right)
        for matrix, x in zip(band, ordered, strict=True):
            x[:] = lapack.dpbsv(matrix.T, x, lower=1, overwrite_ab=1)[1]
        return np.asarray(ordered.reshape(right.shape)[:, self.place])


@compiled
def _ordered(place: Index, edges: Index, width: int, own: Array, between: Array, right: Array) -> tuple[Array, Array]:
    """(K, 3 G, width) the lower bands, column by column, and (K, 3 G) the right sides, both in the new order."""
    systems, nodes = right.shape[:2]
    band, ordered = np.zeros((systems, 3 * nodes, width)), np.empty((systems, 3 * nodes))
    for k in range(systems):
        for g in range(nodes):
            for r in range(3):
                ordered[k, 3 * place[g] + r] = right[k, g, r]
                for c in range(r + 1):
                    band[k, 3 * place[g] + c, r - c] = own[k, g, r, c]
        for e in range(len(edges)):
            one, other = 3 * place[edges[e, 0]], 3 * place[edges[e, 1]]
            for r in range(3):
                for c in range(3):
                    row, column = one + r, other + c
                    band[k, min(row, column), abs(row - column)] = between[k, e, r, c]
    return band, ordered
