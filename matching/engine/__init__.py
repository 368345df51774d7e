"""Places a map in a plan: from votes of corners to a verified answer.

The map may drift: each of its rooms has its own SE(2) motion, tied to those of its neighbours.
"""

from matching.engine.matcher import GeometricMatcher

__all__ = ["GeometricMatcher"]
