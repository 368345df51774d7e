"""The joint adjustment of an anchored map: keyframes and walls as built, from all points that the keyframes saw."""

from sgslam.adjustment.solution import Adjusted, Steps, adjusted
from sgslam.adjustment.wall_points import Faces, WallPoints, faces_of, wall_points

__all__ = ["Adjusted", "Faces", "Steps", "WallPoints", "adjusted", "faces_of", "wall_points"]
