"""Placement of a map that drifts, one SE(2) motion for each room: the default matcher's search and verification."""

from matching.deformation.matcher import DeformableMatcher

__all__ = [
    "DeformableMatcher",
]
