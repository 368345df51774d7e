"""`SceneGraph`, the one type that S-graphs and A-graphs share, and the files that hold one."""

from data.scene_graph.georeference import Georeference
from data.scene_graph.graph import SceneGraph, implausible
from data.scene_graph.nodes import WALL_HEIGHT, Door, Floor, Keyframe, LevelSurface, Room, WallSurface, Xy

__all__ = [
    "WALL_HEIGHT",
    "Door",
    "Floor",
    "Georeference",
    "Keyframe",
    "LevelSurface",
    "Room",
    "SceneGraph",
    "WallSurface",
    "Xy",
    "implausible",
]
