"""Symmetric systems of 3 x 3 blocks, one for each node of a graph and each of its edges, as band matrices.

Nodes are renumbered (E. Cuthill and J. McKee: Reducing the bandwidth of sparse symmetric matrices, 1969), so that
neighbours lie close; Cholesky's factors of a band matrix stay within the band. A map of hundreds of rooms costs what
its width in rooms asks for.
"""

from dataclasses import dataclass

import numpy as np

from matching.se2 import Array
from matching.walls import Index


@dataclass(frozen=True)
class Band:
    """Where the blocks of G nodes and E edges stand in the lower band, column by column."""

    place: Index  # (G,) of each node in the new order
    width: int  # of the band, the diagonal included
    flat: Index  # (9 G + 9 E,) of all blocks, row by row; what is above the diagonal goes to the end, unused

    @staticmethod
    def of(edges: Index, count: int) -> "Band":
        """For edges (E, 2) between `count` nodes, none of them twice."""
        from scipy.sparse import csr_array  # slow to import
        from scipy.sparse.csgraph import reverse_cuthill_mckee

        ends = np.concatenate((edges, edges[:, ::-1]))
        graph = csr_array((np.ones(len(ends), dtype=np.int8), (ends[:, 0], ends[:, 1])), shape=(count, count))
        place = np.empty(count, dtype=np.int64)
        place[reverse_cuthill_mckee(graph, symmetric_mode=True)] = np.arange(count)
        nodes = np.concatenate((np.stack((place, place), axis=1), place[edges]))
        row, column = 3 * nodes[:, 0, None, None] + np.arange(3)[:, None], 3 * nodes[:, 1, None, None] + np.arange(3)
        row, column = (x.ravel() for x in np.broadcast_arrays(row, column))
        upper = np.arange(len(row)) < 9 * count
        upper &= row < column
        row, column = np.maximum(row, column), np.minimum(row, column)
        width = int((row - column).max()) + 1
        return Band(place, width, np.where(upper, 3 * count * width, column * width + row - column))

    def solved(self, own: Array, between: Array, right: Array) -> Array:
        """(K, G, 3) solutions of K systems, which must be positive definite.

        `own` (K, G, 3, 3) on the diagonal, `between` (K, E, 3, 3) at (node 0, node 1) of each edge, and `right`
        (K, G, 3).
        """
        from scipy.linalg import lapack  # slow to import

        K, G = right.shape[:2]
        band = np.zeros((K, 3 * G * self.width + 1))
        band[:, self.flat] = np.concatenate((own.reshape(K, -1), between.reshape(K, -1)), axis=1)
        matrix = band[:, :-1].reshape(K, 3 * G, self.width)
        found = np.empty((K, 3 * G))
        ordered = np.empty((K, G, 3))
        ordered[:, self.place] = right
        for k in range(K):
            found[k] = lapack.dpbsv(matrix[k].T, ordered[k].ravel(), lower=1)[1]
        return found.reshape(K, G, 3)[:, self.place]
