"""The joint adjustment of an anchored map: keyframes and walls as built, from all points that the keyframes saw."""

from sgslam.adjustment.solution import Steps, pose_errors
from sgslam.adjustment.wall_points import Faces, WallPoints, faces_of, wall_points

__all__ = ["Faces", "Steps", "WallPoints", "faces_of", "pose_errors", "wall_points"]
