"""Writes the keyframes and the factors between them as a g2o file."""

from pathlib import Path
from typing import Any

import gtsam
import numpy as np
from numpy.typing import NDArray

from data.common.files import write_atomically
from data.geometry.poses import poses_to_xyzquat
from sgslam.backend.factor_log import FactorLog

FILE = "pose_graph.g2o"
Floats = NDArray[np.float64]
# GTSAM: rotation (rad), translation; g2o: translation, vector part of the unit quaternion (half the angle)
_ORDER = [3, 4, 5, 0, 1, 2]
_UNITS = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])


def write_pose_graph(path: Path, log: FactorLog, poses: Floats) -> int:
    """Writes `VERTEX_SE3:QUAT` of the keyframes, `poses` (K, 4, 4), and `EDGE_SE3:QUAT` of the motions between them.

    Robust losses are left out, as are walls, rooms and the plan. Returns the number of edges.
    """
    lines = [f"VERTEX_SE3:QUAT {i} {_words(row)}" for i, row in enumerate(poses_to_xyzquat(poses))]
    motions = [entry.factor for _, _, entry in log if isinstance(entry.factor, gtsam.BetweenFactorPose3)]
    edges = [_edge(f) for f in motions if all(chr(gtsam.symbolChr(key)) == "x" for key in list(f.keys()))]
    write_atomically(path, "\n".join(lines + edges) + "\n")
    return len(edges)


def _edge(factor: gtsam.BetweenFactorPose3) -> str:
    first, second = (gtsam.symbolIndex(key) for key in list(factor.keys()))
    noise: Any = factor.noiseModel()
    if isinstance(noise, gtsam.noiseModel.Robust):
        noise = noise.noise()
    information = noise.information()[np.ix_(_ORDER, _ORDER)] * np.outer(_UNITS, _UNITS)
    motion = poses_to_xyzquat(factor.measured().matrix())
    return f"EDGE_SE3:QUAT {first} {second} {_words(motion)} {_words(information[np.triu_indices(6)])}"


def _words(numbers: Floats) -> str:
    return " ".join(f"{number:.15g}" for number in numbers.tolist())
