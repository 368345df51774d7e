"""Scores one answer against the truth."""

from collections.abc import Mapping, Set

from data import SceneGraph
from evaluation.matching_benchmark.rows import Tally
from evaluation.metrics.calibration import binned
from evaluation.metrics.matches import matching_scores, unique_is_wrong
from evaluation.metrics.statistics import Score
from evaluation.metrics.true_matches import TrueMatches
from matching.result import MatchResult, Pair


def tallies(result: MatchResult, truth: TrueMatches, s_graph: SceneGraph) -> tuple[Tally, Tally]:
    """The tallies of rooms and of wall surfaces. Raises UserError if the answer violates the contract."""
    scores = matching_scores(result, truth, s_graph)
    return (
        _tally(scores.rooms, result.rooms, truth.rooms, s_graph.room_by_id.keys()),
        _tally(scores.wall_surfaces, result.wall_surfaces, truth.wall_surfaces, s_graph.surface_by_id.keys()),
    )


def is_wrong(result: MatchResult, truth: TrueMatches, bent: bool) -> bool:
    """Whether the answer is `unique` and wrong; if nothing of the map is in the plan, every unique answer is wrong."""
    if not truth.rooms and not truth.wall_surfaces:
        return result.status == "unique"
    return unique_is_wrong(result, truth, bent)


def _tally(score: Score, answer: tuple[Pair, ...], truth: Mapping[str, str], ids: Set[str]) -> Tally:
    spare = ids - truth.keys()
    left = spare - {s for s, _, _ in answer}
    bins = binned([c for _, _, c in answer], [truth.get(s) == a for s, a, _ in answer])
    return Tally(score.right, score.answered, score.expected, len(spare), len(left), bins)
