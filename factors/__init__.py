"""GTSAM factors built from numpy arrays: observed planes, floors, rooms, the BIM frame and its anchors.

The package imports only gtsam and numpy, so it can be used in any factor graph. Planes are (nx, ny, nz, d) with
n.x + d = 0; `T_a_b` maps coordinates in frame b to frame a; lengths are in metres, angles in radians.
"""

from factors.anchors import Anchors, PlaneKeys, anchors_of
from factors.bim import anchor_plane, anchor_point, anchor_room, fit_room, frame_at, plane_from, storey_plane
from factors.noise import noise_of_covariance, noise_of_plane, noise_of_pose, redescending_noise_of_plane
from factors.planes import observe_own_plane, observe_plane, plane_from_wall

__all__ = [
    "Anchors",
    "PlaneKeys",
    "anchor_plane",
    "anchor_point",
    "anchor_room",
    "anchors_of",
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
]
