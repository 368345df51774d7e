"""The local map of oriented surfels: planes of points, the side they were seen from, and which one a point lies on."""

from sgslam.surfels.search import Surfels
from sgslam.surfels.surfel_map import SurfelMap

__all__ = ["SurfelMap", "Surfels"]
