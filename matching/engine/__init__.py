"""Places a map in a plan: from votes of corners and proposed pairs of walls to a verified answer.

The map may drift: each of its rooms has its own SE(2) motion, tied to those of its neighbours.
"""

from matching.engine.field import Scene
from matching.engine.matcher import GeometricMatcher, Proposer, among
from matching.engine.proposals import TopK

__all__ = [
    "GeometricMatcher",
    "Proposer",
    "Scene",
    "TopK",
    "among",
]
