"""The factors that hold, by kind and key: from these each graph is built, and the pose graph of a run is written."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, get_args

import gtsam
import numpy as np
from numpy.typing import NDArray

from data.common.files import write_atomically
from data.geometry.poses import poses_to_xyzquat

Key = tuple[int | str, ...]
Floats = NDArray[np.float64]
Kind = Literal["start", "odometry", "wall", "level", "room", "loop", "anchor"]
KINDS: tuple[Kind, ...] = get_args(Kind)
# in the order in which they were added, so that equal runs give equal graphs; those of a restored run are None until
# they are made again
Factors = dict[Key, gtsam.NonlinearFactor | None]
HeldFactors = dict[Kind, Factors]
POSE_GRAPH = "pose_graph.g2o"
# GTSAM: rotation (rad), translation; g2o: translation, vector part of the unit quaternion (half the angle)
_UNITS = np.array([1.0, 1.0, 1.0, 2.0, 2.0, 2.0])


def graph_of(held: HeldFactors, of: Callable[[Kind, Key], bool] = lambda kind, key: True) -> gtsam.NonlinearFactorGraph:
    """The factor graph of all factors, or of those that are chosen."""
    graph = gtsam.NonlinearFactorGraph()
    for kind, factors in held.items():
        for key, factor in factors.items():
            if factor is not None and of(kind, key):
                graph.add(factor)
    return graph


def write_pose_graph(path: Path, held: HeldFactors, poses: Floats) -> int:
    """Writes `VERTEX_SE3:QUAT` of the keyframes, `poses` (K, 4, 4), and `EDGE_SE3:QUAT` of the motions between them.

    Robust losses are left out, as are walls, rooms and the plan. Returns the number of edges.
    """
    lines = [f"VERTEX_SE3:QUAT {i} {_words(row)}" for i, row in enumerate(poses_to_xyzquat(poses))]
    known = [factor for own in held.values() for factor in own.values()]
    motions = [factor for factor in known if isinstance(factor, gtsam.BetweenFactorPose3)]
    edges = [_edge(f) for f in motions if all(chr(gtsam.symbolChr(key)) == "x" for key in list(f.keys()))]
    write_atomically(path, "\n".join(lines + edges) + "\n")
    return len(edges)


def _edge(factor: gtsam.BetweenFactorPose3) -> str:
    first, second = (gtsam.symbolIndex(key) for key in list(factor.keys()))
    noise: Any = factor.noiseModel()
    if isinstance(noise, gtsam.noiseModel.Robust):
        noise = noise.noise()
    information = np.roll(noise.information(), 3, axis=(0, 1)) * np.outer(_UNITS, _UNITS)
    motion = poses_to_xyzquat(factor.measured().matrix())
    return f"EDGE_SE3:QUAT {first} {second} {_words(motion)} {_words(information[np.triu_indices(6)])}"


def _words(numbers: Floats) -> str:
    return " ".join(f"{number:.15g}" for number in numbers.tolist())
