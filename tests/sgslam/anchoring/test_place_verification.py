"""Place verification: the hypotheses that a map without all rooms allows, and how clear an answer is."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from plans import a_graph, box, merged

from data import Floor, SceneGraph, WallSurface
from data.geometry import se2
from data.scene_graph.motion import moved
from matching import MatchResult
from matching.result import Hypothesis
from sgslam.anchoring.place_verification import (
    CandidatePlace,
    Plan,
    has_close_alternative,
    is_clear,
    is_overwhelming,
    is_strong,
    verified_match,
)
from sgslam.config import AnchorSettings

OFFICE, HALL = a_graph([box(0, 0, 4, 3)], prefix="office"), a_graph([box(4.1, 0, 7, 3)], prefix="hall")
# as the office is beside the hall, but that is narrower
LAB, AULA = a_graph([box(30, 0, 4, 3)], prefix="lab"), a_graph([box(34.1, 0, 7, 5)], prefix="aula")
KNOWN, SEEN = merged(OFFICE, HALL, LAB, AULA), merged(OFFICE, HALL)
Place = tuple[float, float, float]
HERE, IN_THE_LAB, FAR = (0.0, 0.0, 0.0), (0.0, 30.0, 0.0), (0.0, 100.0, 0.0)


def answer(*places: tuple[float, Place]) -> MatchResult:
    hypotheses = tuple(Hypothesis(score, T, None) for score, T in places)
    return MatchResult("ambiguous", "as a matcher says", T_a_s=places[0][1], hypotheses=hypotheses)


def verified(match: MatchResult, s: SceneGraph, known: SceneGraph = KNOWN) -> MatchResult:
    return verified_match(match, s, lambda _: known, AnchorSettings())


@pytest.mark.parametrize(
    ("seen", "places", "status"),
    [
        (SEEN, [(30.0, IN_THE_LAB), (60.0, HERE)], "unique"),  # the lab is in conflict,
        (SEEN, [(40.0, IN_THE_LAB), (60.0, HERE)], "ambiguous"),  # but may be so where the map is not known
        (SEEN, [(70.0, IN_THE_LAB), (60.0, HERE)], "ambiguous"),
        (SEEN, [(70.0, IN_THE_LAB)], "none"),
        (SEEN, [(30.0, HERE)], "none"),
        (OFFICE, [(60.0, HERE), (60.0, IN_THE_LAB)], "ambiguous"),  # one office, where there are two
        (OFFICE, [(40.0, HERE), (0.0, IN_THE_LAB)], "unique"),
        (OFFICE, [(39.9, HERE), (0.0, IN_THE_LAB)], "none"),
        (OFFICE, [(25.0, IN_THE_LAB), (60.0, HERE)], "unique"),
        (OFFICE, [(25.1, IN_THE_LAB), (60.0, HERE)], "ambiguous"),
    ],
)
def test_places_in_conflict_are_dropped_and_the_best_needs_evidence_and_no_other_one(
    seen: SceneGraph, places: list[tuple[float, Place]], status: str
) -> None:
    found = verified(answer(*places), seen)
    assert found.status == status
    walls = {(w.id, w.id) for w in seen.wall_surfaces} if status == "unique" else set()
    assert found.T_a_s == (HERE if walls else None) and {(s, a) for s, a, _ in found.wall_surfaces} == walls


def test_no_place_is_no_answer_and_a_place_is_the_same_wherever_the_map_lies() -> None:
    assert verified(MatchResult("none", "nothing"), SEEN).status == "none"
    T = np.array([2.1, 30.0, -7.0])
    yaw, x, y = se2.inverse(T).tolist()
    found = verified(answer((60.0, (yaw, x, y))), moved(SEEN, T))
    assert found.status == "unique" and len(found.wall_surfaces) == len(SEEN.wall_surfaces)


def unique(*scores: float) -> MatchResult:
    return MatchResult("unique", "", T_a_s=HERE, hypotheses=tuple(Hypothesis(s, HERE, None) for s in scores))


@pytest.mark.parametrize(
    ("judge", "enough", "too_little"),
    [
        (is_clear, [(60.0, 35.9), (40.0,)], [(60.0, 36.0), (60.0, 1.0, 36.0), (39.9,), ()]),
        (is_strong, [(50.0, 50.0)], [(49.9,), ()]),
        (is_overwhelming, [(100.0, 100.0)], [(99.9,), ()]),
    ],
)
def test_an_answer_is_clear_or_strong_by_its_evidence(
    judge: Callable[[MatchResult], bool], enough: list[tuple[float, ...]], too_little: list[tuple[float, ...]]
) -> None:
    assert all(judge(unique(*scores)) for scores in enough)
    assert not any(judge(unique(*scores)) for scores in too_little)
    assert not any(judge(replace(unique(*scores), status="ambiguous")) for scores in enough)


@pytest.mark.parametrize(
    ("conflict", "other", "close"),
    [(0.01, 36.0, False), (0.01, 36.1, True), (0.0101, 24.0, False), (0.0101, 24.1, True)],
)
def test_a_place_with_some_conflict_needs_a_larger_margin(conflict: float, other: float, close: bool) -> None:
    best, second, third = (CandidatePlace(score, np.zeros(3), None) for score in (60.0, other, 1.0))
    assert has_close_alternative(best, [third, second, best], conflict) is close
    assert not has_close_alternative(best, [best], conflict)


def with_screens(width: float, depth: float, count: int) -> tuple[SceneGraph, SceneGraph]:
    """A hall as it is known, and as it is seen: with so many screens in it, each in conflict by 0.2 m."""
    hall = a_graph([box(0, 0, width, depth)])
    screens = [WallSurface(f"s{k}", None, (2.0 + 0.3 * k, 4.0), (1.0, 0.0), 0.2) for k in range(count)]
    return hall, replace(hall, wall_surfaces=(*hall.wall_surfaces, *screens))


# the walls of these halls count once for each map: every 0.2 m, 392, 396 and 384 in all
@pytest.mark.parametrize(
    ("size", "screens", "places", "status"),
    [
        ((9.8, 9.8), 8, [(60.0, HERE)], "unique"),  # a fiftieth in conflict
        ((9.8, 9.8), 9, [(60.0, HERE)], "none"),
        ((9.8, 10.0), 4, [(60.0, HERE), (30.0, FAR)], "unique"),  # a hundredth, beside a place with half the evidence
        ((9.8, 10.0), 5, [(60.0, HERE), (30.0, FAR)], "ambiguous"),
    ],
)
def test_a_little_conflict_is_accepted_and_a_half_of_that_is_doubtful(
    size: tuple[float, float], screens: int, places: list[tuple[float, Place]], status: str
) -> None:
    known, seen = with_screens(*size, screens)
    assert verified(answer(*places), seen, known).status == status


@pytest.mark.parametrize(("screens", "conflict"), [(16, False), (17, True)])
def test_a_committed_place_is_withdrawn_from_a_twentyfifth_in_conflict_on(screens: int, conflict: bool) -> None:
    known, seen = with_screens(9.6, 9.6, screens)
    partial = Plan(known, partial=True)
    here = -np.array([0.0, *partial.origin[:2]])  # in the local frame
    assert partial.conflicts(seen, here, None) is conflict
    assert not Plan(known).conflicts(seen, here, None)


def test_heights_of_a_plan_are_above_its_lowest_floor() -> None:
    floors = (Floor("up", "", 7.0), Floor("low", "", 4.0), Floor("attic", ""))
    plan = Plan(replace(KNOWN, floors=floors))
    assert [plan.height(floor) for floor in ("up", "low", "attic", None)] == [3.0, 0.0, None, None]
    assert plan.origin.tolist() == [*KNOWN.centroid().tolist(), 4.0]
