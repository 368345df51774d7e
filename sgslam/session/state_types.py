"""The dataclasses that a saved run state may contain."""

from data.scene_graph import Door, Floor, Keyframe, Room, SceneGraph, WallSurface
from matching.result import Hypothesis, MatchResult
from sgslam.anchoring import AnchorRecord
from sgslam.anchoring.anchor_log import AnchorEvent
from sgslam.anchoring.place_posterior import Place, PlacePosterior
from sgslam.backend import FactorEvent
from sgslam.mapping import Anchors, Closure, KeyframeNode, PlannedWall, RoomNode, Scene, SeenLevel, SeenWall
from sgslam.registration.beliefs import Belief
from sgslam.session.scan_poses import ScanPose
from sgslam.tracking.run_tracker import Losses
from sgslam.types import Motion, RawScan, Registration, TimedPoints, TrackedScan, UnsteadyTurn

TYPES: dict[str, type] = {
    kind.__name__: kind
    for kind in (
        AnchorEvent, AnchorRecord, Anchors, Belief, Closure, Door, FactorEvent, Floor, Hypothesis,
        Keyframe, KeyframeNode, Losses, MatchResult, Motion, Place, PlacePosterior, PlannedWall,
        RawScan, Registration, Room, RoomNode, ScanPose, Scene, SceneGraph, SeenLevel, SeenWall, TimedPoints,
        TrackedScan, UnsteadyTurn, WallSurface,
    )
}  # fmt: skip
