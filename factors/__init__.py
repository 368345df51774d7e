"""GTSAM factors from numpy arrays: plane observations, floors, rooms, the BIM frame and its anchors.

Imports gtsam and numpy only, so that it serves in anybody's graph.
"""

from factors.bim import anchor_plane, anchor_room, frame_at, plane_from, storey_plane
from factors.noise import noise_of_covariance, noise_of_plane, noise_of_pose, redescending_noise_of_plane
from factors.planes import observe_own_plane, observe_plane, plane_from_wall
from factors.rooms import fit_room, wall_of_room

__all__ = [
    "anchor_plane",
    "anchor_room",
    "fit_room",
    "frame_at",
    "noise_of_covariance",
    "noise_of_plane",
    "noise_of_pose",
    "observe_own_plane",
    "observe_plane",
    "plane_from",
    "plane_from_wall",
    "redescending_noise_of_plane",
    "storey_plane",
    "wall_of_room",
]
