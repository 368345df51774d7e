"""Marginal covariances of the factor graph, from its linearisation at the optimum."""

from collections.abc import Callable, Mapping
from typing import Any

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, P, X
from numpy.typing import NDArray

from sgslam.backend.noise_shown import noise_shown
from sgslam.backend.shared_offsets import shared_offsets
from sgslam.geometry.frames import transform_planes
from sgslam.mapping import PlannedWall

Floats = NDArray[np.float64]
_BIM = B(0)
_PLANES = ("p", "f", "u")  # symbols of plane variables, which have three dimensions; all others are poses
_STEP = 1e-5  # of numeric derivatives, rad and m


class Uncertainty:
    """Marginals of a graph at its optimum `values`; robust losses enter with their weights there.

    The noise of each kind of measurement (walls, floors, plan, ...) is the one that its residuals show. The information
    matrix is factored for them and again for the queries, each of which costs one sparse solution for each of its rows.
    `anchor_of` gives the keyframe in whose frame a wall is estimated, `planned` by the key of its frame the planned
    wall of each anchor that is not loose. Raises RuntimeError where a variable is free.
    """

    def __init__(
        self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, anchor_of: dict[int, int],
        planned: Mapping[int, PlannedWall],
    ) -> None:  # fmt: skip
        from scipy.sparse import csc_matrix, diags

        self._values, self._anchor_of = values, anchor_of
        keys = list(values.keys())  # sorted, as the columns are
        sizes = [3 if chr(gtsam.symbolChr(key)) in _PLANES else 6 for key in keys]
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

    def knows(self, wall: int) -> bool:
        """Whether a wall is in the graph; walls seen from a single keyframe are not."""
        return wall in self._anchor_of

    def pose_covariances(self, keyframes: list[int]) -> Floats:
        """(N, 6, 6) of T_bim_sensor (of T_map_sensor where the graph has no BIM frame), rotation first (rad), then
        translation (m), in the sensor's axes."""
        covariances = np.empty((len(keyframes), 6, 6))
        for covariance, keyframe in zip(covariances, keyframes, strict=True):
            J = np.zeros((6, self._size))  # one at a time: those of a long run would take a hundred megabytes
            J[:, self._columns[X(keyframe)]] = np.eye(6)
            if self.anchored:
                T_map_bim, T_map_sensor = self._values.atPose3(_BIM), self._values.atPose3(X(keyframe))
                J[:, self._columns[_BIM]] = -T_map_sensor.inverse().compose(T_map_bim).AdjointMap()
            covariance[:] = J @ self._solve(np.asfortranarray(J.T))
        return np.asarray((covariances + covariances.transpose(0, 2, 1)) / 2)

    def wall_offset(self, wall: int, planned: Floats, point: Floats) -> tuple[float, float]:
        """The offset (m) of a wall along the normal of its planned plane (4,), and its variance, at `point` (3,).

        Plane and point are in the graph's BIM frame.
        """
        anchor = self._anchor_of[wall]
        keys = (_BIM, X(anchor), P(wall))
        pose_b, pose_x = self._values.atPose3(keys[0]), self._values.atPose3(keys[1])
        plane = self._values.atOrientedPlane3(keys[2])
        here = planned[:3] @ point + planned[3]
        foot = point - here * planned[:3]

        def offset(b: gtsam.Pose3, x: gtsam.Pose3, p: gtsam.OrientedPlane3) -> float:
            T_bim_anchor = b.inverse().compose(x).matrix()
            n = transform_planes(T_bim_anchor, p.planeCoefficients().ravel())
            return float(-(n[:3] @ foot + n[3]) / (n[:3] @ planned[:3]))

        value = offset(pose_b, pose_x, plane)
        J = np.zeros(self._size)
        for k, size in ((0, 6), (1, 6), (2, 3)):
            for axis in range(size):
                step = np.zeros(size)
                step[axis] = _STEP
                moved: list[Any] = [pose_b, pose_x, plane]
                moved[k] = moved[k].retract(step)
                J[self._columns[keys[k]].start + axis] = (offset(*moved) - value) / _STEP
        return value, float(J @ self._solve(J))


def _solver(jacobian: Any) -> Callable[[Floats], Floats]:
    """Solves the normal equations of a sparse Jacobian. Raises RuntimeError where they are singular."""
    from scipy.sparse.linalg import splu

    solve: Callable[[Floats], Floats] = splu(
        (jacobian.T @ jacobian).tocsc(), "MMD_AT_PLUS_A", 0.0, options={"SymmetricMode": True}
    ).solve  # fmt: skip
    return solve
