"""Place verification: the hypotheses that a map without all rooms allows, and how clear an answer is."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from test_free_space_conflict import a_room, graph

from data import Floor, SceneGraph, WallSurface
from data.geometry import se2
from matching import MatchResult
from matching.protocol import Match
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

OFFICE, HALL, LAB = a_room("office", 0, 0, 4, 3), a_room("hall", 4.1, 0, 7, 3), a_room("lab", 30, 0, 4, 3)
AULA = a_room("aula", 34.1, 0, 7, 5)  # beside the lab, as the hall is beside the office, but wider
KNOWN, SEEN = graph(OFFICE, HALL, LAB, AULA), graph(OFFICE, HALL)
HERE, IN_THE_LAB = (0.0, 0.0, 0.0), (0.0, 30.0, 0.0)


def answer(*places: tuple[float, tuple[float, float, float]]) -> MatchResult:
    hypotheses = tuple(Hypothesis(score, T, None) for score, T in places)
    return MatchResult("ambiguous", "as a matcher says", T_a_s=places[0][1], hypotheses=hypotheses)


def verified(match: MatchResult, s: SceneGraph = SEEN) -> MatchResult:
    return verified_match(match, s, lambda _: KNOWN, AnchorSettings())


def test_a_place_in_conflict_with_the_known_map_is_dropped() -> None:
    found = verified(answer((30.0, IN_THE_LAB), (60.0, HERE)))
    assert found.status == "unique" and found.T_a_s == HERE
    assert {(s, a) for s, a, _ in found.wall_surfaces} == {(w.id, w.id) for w in SEEN.wall_surfaces}


@pytest.mark.parametrize("nats", [40.0, 70.0])
def test_a_building_that_repeats_itself_may_do_so_where_it_is_not_known(nats: float) -> None:
    assert verified(answer((nats, IN_THE_LAB), (60.0, HERE))).status == "ambiguous"


def test_a_map_of_one_office_stays_ambiguous_where_there_are_two() -> None:
    assert verified(answer((60.0, HERE), (60.0, IN_THE_LAB)), graph(OFFICE)).status == "ambiguous"
    assert verified(answer((80.0, HERE), (40.0, IN_THE_LAB)), graph(OFFICE)).status == "ambiguous"  # mapped in part
    assert verified(answer((80.0, HERE), (15.0, IN_THE_LAB)), graph(OFFICE)).status == "unique"


@pytest.mark.parametrize("match", [answer((70.0, IN_THE_LAB)), answer((30.0, HERE)), MatchResult("none", "nothing")])
def test_a_place_with_conflict_or_little_evidence_is_no_answer(match: MatchResult) -> None:
    found = verified(match)
    assert found.status == "none" and found.T_a_s is None and not found.wall_surfaces


def test_the_answer_is_the_same_wherever_the_map_lies() -> None:
    T = (2.1, 30.0, -7.0)  # of the seen map
    back = se2.inverse(np.array(T)).tolist()
    found = verified(answer((60.0, (back[0], back[1], back[2]))), graph(OFFICE, HALL, T=T))
    assert found.status == "unique" and len(found.wall_surfaces) == len(SEEN.wall_surfaces)


def unique(*scores: float) -> MatchResult:
    return MatchResult("unique", "", T_a_s=HERE, hypotheses=tuple(Hypothesis(s, HERE, None) for s in scores))


@pytest.mark.parametrize(
    ("scores", "clear"),
    [((60.0, 35.9), True), ((60.0, 36.0), False), ((40.0,), True), ((39.9,), False), ((60.0, 1.0, 36.0), False),
     ((), False)],
)  # fmt: skip
def test_an_answer_is_clear_where_nothing_comes_near_it(scores: tuple[float, ...], clear: bool) -> None:
    assert is_clear(unique(*scores)) is clear
    assert not is_clear(replace(unique(*scores), status="ambiguous"))


@pytest.mark.parametrize(("judge", "limit"), [(is_strong, 50.0), (is_overwhelming, 100.0)])
def test_an_answer_is_strong_by_its_evidence(judge: Callable[[Match], bool], limit: float) -> None:
    assert judge(unique(limit, limit)) and not judge(unique(limit - 0.1)) and not judge(unique())
    assert not judge(replace(unique(limit), status="ambiguous"))


@pytest.mark.parametrize(
    ("conflict", "other", "close"),
    [(0.01, 36.0, False), (0.01, 36.1, True), (0.0101, 24.0, False), (0.0101, 24.1, True)],
)
def test_a_place_with_some_conflict_needs_a_larger_margin(conflict: float, other: float, close: bool) -> None:
    best, second, third = (CandidatePlace(score, np.zeros(3), None) for score in (60.0, other, 1.0))
    assert has_close_alternative(best, [third, second, best], conflict) is close
    assert not has_close_alternative(best, [best], conflict)


@pytest.mark.parametrize(
    ("best", "second", "status"),
    [(40.0, 0.0, "unique"), (39.9, 0.0, "none"), (60.0, 25.0, "unique"), (60.0, 25.1, "ambiguous")],
)
def test_a_place_without_conflict_needs_evidence_and_no_other_one(best: float, second: float, status: str) -> None:
    assert verified(answer((second, IN_THE_LAB), (best, HERE)), graph(OFFICE)).status == status


def with_screens(width: float, depth: float, count: int) -> tuple[SceneGraph, SceneGraph]:
    """A hall as it is known, and as it is seen: with so many screens in it, each in conflict by 0.2 m."""
    hall = a_room("hall", 0, 0, width, depth)
    screens = [WallSurface(f"s{k}", "hall", (2.0 + 0.3 * k, 4.0), (1.0, 0.0), 0.2) for k in range(count)]
    return graph(hall), graph((hall[0], [*hall[1], *screens]))


# the walls of these halls count once for each map: every 0.2 m, 392, 384 and 396 in all
@pytest.mark.parametrize(("screens", "status"), [(8, "unique"), (9, "none")])
def test_a_place_is_accepted_with_a_fiftieth_in_conflict_at_most(screens: int, status: str) -> None:
    known, seen = with_screens(9.8, 9.8, screens)
    assert verified_match(answer((60.0, HERE)), seen, lambda _: known, AnchorSettings()).status == status


@pytest.mark.parametrize(("screens", "status"), [(4, "unique"), (5, "ambiguous")])
def test_a_place_is_doubtful_from_a_hundredth_in_conflict_on(screens: int, status: str) -> None:
    known, seen = with_screens(9.8, 10.0, screens)
    elsewhere = (30.0, (0.0, 100.0, 0.0))  # half the evidence, in conflict itself
    assert verified_match(answer((60.0, HERE), elsewhere), seen, lambda _: known, AnchorSettings()).status == status


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
    assert plan.storey(None) is plan.a_graph and plan.storey("up") is plan.storey("up")
