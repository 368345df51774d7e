"""Places a map in a plan: from proposed pairs of walls to a verified answer.

The map may drift: each of its rooms has its own SE(2) motion, tied to those of its neighbours.
"""

from matching.engine.matcher import GeometricMatcher, Proposer, among

__all__ = [
    "GeometricMatcher",
    "Proposer",
    "among",
]
