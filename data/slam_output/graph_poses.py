"""The poses of a factor graph (`.g2o`), and how uncertain each motion between them is."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from data.scene_graph.g2o import PlaneGraph, Step, read_g2o
from data.trajectory.readers import PoseList

Floats = NDArray[np.float64]
_ORDER = [3, 4, 5, 0, 1, 2]  # rotation first
_VECTOR_OF_ANGLE = np.diag([0.5, 0.5, 0.5, 1.0, 1.0, 1.0])  # a quaternion's vector part is half an angle


def read_graph_poses(path: Path) -> PoseList:
    """The poses in the order of their ids, without stamps, with the covariances of the motions that the graph joins.

    The file's information matrices give the proportions of the covariances. Their common factor is estimated from what
    is left of the edges at the poses of the file (a posteriori variance of unit weight), where edges close loops;
    otherwise it is one. Where every matrix is the identity, they say nothing. Raises UserError for a file that is no
    graph of poses.
    """
    graph = read_g2o(path, poses_only=True)
    ids = sorted(graph.keyframes)
    before, factor = dict(zip(ids[1:], ids, strict=False)), _variance(graph)
    covariances: dict[int, Floats] = {}
    for step in graph.steps:
        low, high = sorted((step.first, step.second))
        information = _information(step)
        if before.get(high) != low or np.linalg.eigvalsh(information)[0] <= 0:
            continue
        own = factor * np.linalg.inv(information)  # in the axes of the second
        if step.second == low:
            turn = np.kron(np.eye(2), graph.keyframes[high][:3, :3].T @ graph.keyframes[low][:3, :3])
            own = turn @ own @ turn.T
        covariances[high] = (own + own.T) / 2
    if all(np.array_equal(step.information, np.eye(6)) for step in graph.steps):
        covariances = {}
    poses = np.stack([graph.keyframes[i] for i in ids])
    return PoseList(poses, None, [covariances.get(i) for i in ids])


def _information(step: Step) -> Floats:
    """(6, 6) of rotation (rad), then translation (m)."""
    return np.asarray(_VECTOR_OF_ANGLE @ step.information[np.ix_(_ORDER, _ORDER)] @ _VECTOR_OF_ANGLE)


def _variance(graph: PlaneGraph) -> float:
    """The variance of unit weight; 1 where nothing closes a loop."""
    from scipy.spatial.transform import Rotation  # here, because it takes a third of a second

    total, spare = 0.0, 6 * (len(graph.steps) - len(graph.keyframes) + 1)
    for step in graph.steps:
        found = np.linalg.inv(graph.keyframes[step.first]) @ graph.keyframes[step.second]
        error = np.linalg.inv(step.T_first_second) @ found
        residual = np.concatenate([Rotation.from_matrix(error[:3, :3]).as_rotvec(), error[:3, 3]])
        total += float(residual @ _information(step) @ residual)
    return total / spare if spare > 0 and total > 0 else 1.0
