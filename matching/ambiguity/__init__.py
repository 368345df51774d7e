"""Before any robot drives: symmetries of a plan, its defects, and how many rooms must be seen to localise in it."""

from matching.ambiguity.match_cache import MatchCache, Trials
from matching.ambiguity.plan_checks import PlanIssue, plan_issues
from matching.ambiguity.rooms_to_localise import RoomsToLocalise
from matching.ambiguity.self_similarity import SelfSimilarity, SimilarPlace
from matching.ambiguity.symmetries import Symmetry

__all__ = [
    "MatchCache",
    "PlanIssue",
    "RoomsToLocalise",
    "SelfSimilarity",
    "SimilarPlace",
    "Symmetry",
    "Trials",
    "plan_issues",
]
