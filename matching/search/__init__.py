"""Rigid placement of a map in a plan, the matcher `voting`: proposals, evidence, verification, assignment."""

from matching.search.proposals import Proposals, TopK
from matching.search.start import Start, near_start

__all__ = [
    "Proposals",
    "Start",
    "TopK",
    "near_start",
]
