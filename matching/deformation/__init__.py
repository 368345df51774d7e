"""Placements of a map that drifts: a field of motions, one a room, with its evidence and verification."""

from matching.deformation.matcher import DeformableMatcher

__all__ = [
    "DeformableMatcher",
]
