"""Asks a method for one pair, and scores its answer against the truth."""

from collections.abc import Mapping, Set
from dataclasses import astuple
from time import perf_counter

from data import SceneGraph
from evaluation.harness.time_limit import time_limit
from evaluation.matching_benchmark.methods import load_method
from evaluation.matching_benchmark.pairs import Prepared
from evaluation.matching_benchmark.records import MatchRecord, Tally
from evaluation.metrics.calibration import binned
from evaluation.metrics.matches import matching_scores, unique_is_wrong
from evaluation.metrics.statistics import Score
from evaluation.metrics.true_matches import TrueMatches
from matching.result import MatchResult, Pair


def judged(prepared: Prepared, method: str, limit_s: float) -> MatchRecord:
    """The record of a method's answer; a method that raises gets the status "failed", one that takes too long "late".

    Raises UserError for an unknown method.
    """
    answer, s_graph = load_method(method), prepared.drawn.s_graph
    rooms, walls = tallies(MatchResult("none", ""), prepared.truth, s_graph)
    blank = MatchRecord(
        status="late", reason=f"stopped after {limit_s:g} s", wrong=False, twin=prepared.twin, rival=prepared.rival,
        seconds=limit_s, building=prepared.plan.building, size=len(prepared.plan.graph.rooms),
        s_rooms=len(s_graph.rooms), s_walls=len(s_graph.wall_surfaces), room_tally=rooms, wall_tally=walls,
    )  # fmt: skip
    began = perf_counter()
    try:
        with time_limit(limit_s):
            result = answer(prepared)
        seconds = perf_counter() - began
        rooms, walls = tallies(result, prepared.truth, s_graph)
        wrong = is_wrong(result, prepared.truth, prepared.drawn.deformed)
    except TimeoutError:
        return blank
    except Exception as error:
        reason = f"{type(error).__name__}: {error}".splitlines()[0]
        return blank.model_copy(update={"status": "failed", "reason": reason, "seconds": perf_counter() - began})
    found = {"status": result.status, "reason": result.reason, "wrong": wrong, "seconds": seconds}
    return blank.model_copy(update={**found, "room_tally": rooms, "wall_tally": walls})


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
    bins = binned([c for _, _, c in answer], [truth.get(s) == a for s, a, _ in answer])
    return Tally(
        right=score.right, answered=score.answered, true=score.expected, spare=len(spare),
        left=len(spare - {s for s, _, _ in answer}), bins=tuple(astuple(b) for b in bins),
    )  # fmt: skip
