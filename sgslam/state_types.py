"""The dataclasses that a saved run may hold."""

from data.scene_graph import Door, Floor, Keyframe, Room, SceneGraph, WallSurface
from matching.result import Hypothesis, MatchResult
from sgslam.anchor_log import AnchorEvent, AnchorRecord
from sgslam.factor_log import FactorEvent
from sgslam.floor_extraction import FloorObservation
from sgslam.graph_nodes import Anchors, Closure, PlannedWall, RoomNode
from sgslam.keyframes import KeyframeNode
from sgslam.leaps import Doubted
from sgslam.locating import Located
from sgslam.result import ScanPose
from sgslam.said import Growth, Said
from sgslam.scene import Scene
from sgslam.wall_map import Lines, SeenWall

TYPES: dict[str, type] = {
    kind.__name__: kind
    for kind in (
        AnchorEvent, AnchorRecord, Anchors, Closure, Door, Doubted, FactorEvent, Floor, FloorObservation, Growth,
        Hypothesis, Keyframe, KeyframeNode, Lines, Located, MatchResult, PlannedWall, Room, RoomNode, Said, ScanPose,
        Scene, SceneGraph, SeenWall, WallSurface,
    )
}  # fmt: skip
