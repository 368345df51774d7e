"""The dataclasses that a saved run state may contain."""

from data.scene_graph import Door, Floor, Keyframe, Room, SceneGraph, WallSurface
from matching.result import Hypothesis, MatchResult
from sgslam.anchoring.anchor_log import AnchorEvent, AnchorRecord
from sgslam.anchoring.match_history import MapSize, UniqueMatch
from sgslam.backend.factor_log import FactorEvent
from sgslam.mapping.graph_nodes import Anchors, Closure, PlannedWall, RoomNode
from sgslam.mapping.keyframes import KeyframeNode
from sgslam.mapping.scene import Scene
from sgslam.mapping.wall_map import Lines, SeenWall
from sgslam.perception.floor_extraction import FloorObservation
from sgslam.perception.scan_checks import RawScan
from sgslam.session.scan_poses import ScanPose
from sgslam.tracking.scan_tracker import Located

TYPES: dict[str, type] = {
    kind.__name__: kind
    for kind in (
        AnchorEvent, AnchorRecord, Anchors, Closure, Door, FactorEvent, Floor, FloorObservation, Hypothesis, Keyframe,
        KeyframeNode, Lines, Located, MapSize, MatchResult, PlannedWall, RawScan, Room, RoomNode, ScanPose, Scene,
        SceneGraph, SeenWall, UniqueMatch, WallSurface,
    )
}  # fmt: skip
