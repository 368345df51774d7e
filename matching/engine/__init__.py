"""Placement of a map that drifts, one SE(2) motion for each room: the default matcher's search and verification."""

from matching.engine.matcher import DeformableMatcher

__all__ = [
    "DeformableMatcher",
]
