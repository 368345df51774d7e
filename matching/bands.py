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


@compiled
def solve(band: Array, x: Array) -> None:
    """Writes the solution of a positive definite system into its right side (n,).

    `band` (n, width) is the lower band, column by column, and is lost. Few of its numbers are not 0: those are passed.
    """
    n, width = band.shape
    for c in range(n):
        column = band[c, : min(width, n - c)]
        inverse = 1 / np.sqrt(column[0])
        for d in range(len(column)):
            column[d] *= inverse
        x[c] *= inverse
        for d in range(1, len(column)):
            factor = column[d]
            if factor != 0.0:
                later, rest = band[c + d], column[d:]
                for e in range(len(rest)):
                    later[e] -= factor * rest[e]
                x[c + d] -= factor * x[c]
    for c in range(n - 1, -1, -1):
        rest = x[c]
        for d in range(1, min(width, n - c)):
            rest -= band[c, d] * x[c + d]
        x[c] = rest / band[c, 0]
