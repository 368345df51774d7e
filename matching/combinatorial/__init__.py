"""The combinatorial search of iS-Graphs, as a baseline."""

from matching.combinatorial.search import CombinatorialMatcher
from matching.combinatorial.settings import DEVELOP, GRID, CombinatorialSettings

__all__ = [
    "DEVELOP",
    "GRID",
    "CombinatorialMatcher",
    "CombinatorialSettings",
]
