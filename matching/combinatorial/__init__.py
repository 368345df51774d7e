"""The combinatorial search of iS-Graphs, a baseline: finds an S-graph in an A-graph without learning."""

from matching.combinatorial.search import CombinatorialMatcher

__all__ = ["CombinatorialMatcher"]
