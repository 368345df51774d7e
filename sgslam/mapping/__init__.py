"""The map: keyframes, walls, rooms, floors, and the S-graph made of them."""

from sgslam.mapping.floor_transition import FloorTransition
from sgslam.mapping.floors import FloorMap, Floors
from sgslam.mapping.keyframe_clouds import KeyframeClouds
from sgslam.mapping.keyframes import Anchors, Closure, KeyframeNode, KeyframeRule, PlannedWall, RoomNode
from sgslam.mapping.level_map import LevelMap, SeenLevel
from sgslam.mapping.scene import Scene
from sgslam.mapping.wall_map import SeenWall, WallMap

__all__ = [
    "Anchors",
    "Closure",
    "FloorMap",
    "FloorTransition",
    "Floors",
    "KeyframeClouds",
    "KeyframeNode",
    "KeyframeRule",
    "LevelMap",
    "PlannedWall",
    "RoomNode",
    "Scene",
    "SeenLevel",
    "SeenWall",
    "WallMap",
]
