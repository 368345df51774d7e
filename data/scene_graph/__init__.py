"""`SceneGraph`, the one type that S-graphs and A-graphs share, and the files that hold one."""

from data.scene_graph.graph import Door, Floor, Keyframe, Room, SceneGraph, WallSurface, Xy
from data.scene_graph.plausibility import implausible

__all__ = ["Door", "Floor", "Keyframe", "Room", "SceneGraph", "WallSurface", "Xy", "implausible"]
