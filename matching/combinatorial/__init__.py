"""The combinatorial search of iS-Graphs."""

from matching.combinatorial.search import CombinatorialMatcher
from matching.combinatorial.settings import DEVELOP, GRID, CombinatorialSettings

__all__ = [
    "DEVELOP",
    "GRID",
    "CombinatorialMatcher",
    "CombinatorialSettings",
]
