"""Where the map lies in the plan: S-graph to A-graph matching with verification."""

from matching.matcher import Matcher
from matching.result import Hypothesis, MatchResult

__all__ = ["Hypothesis", "MatchResult", "Matcher"]
