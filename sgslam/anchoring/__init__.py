"""Anchoring: the place of the map in the plan, from matches and wall alignment, and the anchors that follow."""

from sgslam.anchoring.anchor_log import AnchorRecord
from sgslam.anchoring.building_anchoring import BuildingAnchoring
from sgslam.anchoring.storey_hypotheses import check_storey, floor_named
from sgslam.anchoring.wall_alignment import AlignedWall, WallAlignment, align_walls

__all__ = [
    "AlignedWall",
    "AnchorRecord",
    "BuildingAnchoring",
    "WallAlignment",
    "align_walls",
    "check_storey",
    "floor_named",
]
