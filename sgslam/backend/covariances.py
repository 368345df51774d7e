"""Marginal covariances of the factor graph, from its linearisation at the optimum."""

from collections.abc import Callable, Mapping
from typing import Any

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, X
from numpy.typing import NDArray

from sgslam.backend.noise_shown import noise_shown
from sgslam.backend.shared_offsets import shared_offsets
from sgslam.mapping import PlannedWall

Floats = NDArray[np.float64]
_BIM = B(0)
_DIMENSIONS = {"p": 3, "f": 3, "u": 3, "v": 1}  # of planes and of walls' offsets; all other variables are poses


class Uncertainty:
    """Marginals of a graph at its optimum `values`; robust losses enter with their weights there.

    The noise of each kind of measurement (walls, floors, plan, ...) is the one that its residuals show. The information
    matrix is factored for them and again for the queries, each of which costs one sparse solution for each of its rows.
    `planned` gives, by the key of its frame, the planned wall of each anchor that is not loose. Raises RuntimeError
    where a variable is free.
    """

    def __init__(
        self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, planned: Mapping[int, PlannedWall]
    ) -> None:
        from scipy.sparse import csc_matrix, diags

        self._values = values
        keys = sorted(set(graph.keyVector()))
        sizes = [_DIMENSIONS.get(chr(gtsam.symbolChr(key)), 6) for key in keys]
        starts = np.concatenate([[0], np.cumsum(sizes)]).tolist()
        self._columns = {key: slice(a, b) for key, a, b in zip(keys, starts[:-1], starts[1:], strict=True)}
        self._size = int(starts[-1])
        rows, columns, entries = graph.linearize(values).sparseJacobian_()
        rows, columns = rows.astype(np.int64) - 1, columns.astype(np.int64) - 1  # they count from one
        shape, of_jacobian = (int(rows.max()) + 1, self._size), columns < self._size  # the last column is the residual
        jacobian = csc_matrix((entries[of_jacobian], (rows[of_jacobian], columns[of_jacobian])), shape=shape)
        scale = noise_shown(graph, values, jacobian.tocsr(), _solver(jacobian))
        first = np.cumsum([0, *(graph.at(i).dim() for i in range(graph.size()))])
        for index, larger in shared_offsets(graph, values, planned).items():
            scale[first[index] : first[index + 1]] *= larger
        self._solve = _solver(diags(1 / scale) @ jacobian)

    @property
    def anchored(self) -> bool:
        """Whether the graph has a BIM frame."""
        return _BIM in self._columns

    def pose_covariances(self, keyframes: list[int]) -> Floats:
        """(N, 6, 6) of T_bim_sensor (of T_map_sensor where the graph has no BIM frame), rotation first (rad), then
        translation (m), in the sensor's axes."""
        covariances = np.empty((len(keyframes), 6, 6))
        for covariance, keyframe in zip(covariances, keyframes, strict=True):
            J = np.zeros((6, self._size))  # one at a time: those of a long run would take a hundred megabytes
            J[:, self._columns[X(keyframe)]] = np.eye(6)
            if self.anchored:
                T_map_local, T_map_sensor = self._values.atPose3(_BIM), self._values.atPose3(X(keyframe))
                J[:, self._columns[_BIM]] = -T_map_sensor.inverse().compose(T_map_local).AdjointMap()
            covariance[:] = J @ self._solve(np.asfortranarray(J.T))
        return np.asarray((covariances + covariances.transpose(0, 2, 1)) / 2)


def _solver(jacobian: Any) -> Callable[[Floats], Floats]:
    """Solves the normal equations of a sparse Jacobian. Raises RuntimeError where they are singular."""
    from scipy.sparse.linalg import splu

    solve: Callable[[Floats], Floats] = splu(
        (jacobian.T @ jacobian).tocsc(), "MMD_AT_PLUS_A", 0.0, options={"SymmetricMode": True}
    ).solve  # fmt: skip
    return solve
