"""Place verification: the hypotheses that a map without all rooms allows, and how clear an answer is."""

import numpy as np
import pytest
from test_free_space_conflict import a_room, graph

from data import SceneGraph
from data.geometry import se2
from matching import MatchResult
from matching.result import Hypothesis
from sgslam.anchoring.match_history import MapSize, UniqueMatch
from sgslam.anchoring.place_verification import (
    CandidatePlace,
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


def test_a_place_with_some_conflict_needs_a_larger_margin() -> None:
    best, other = (CandidatePlace(score, np.zeros(3), None) for score in (60.0, 30.0))
    assert not has_close_alternative(best, [other, best], 0.0) and has_close_alternative(best, [other, best], 0.015)
    assert not has_close_alternative(best, [best], 0.015)


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


def test_an_answer_is_clear_where_nothing_comes_near_it() -> None:
    def unique(*scores: float) -> MatchResult:
        return MatchResult("unique", "", T_a_s=HERE, hypotheses=tuple(Hypothesis(s, HERE, None) for s in scores))

    assert is_clear(unique(60.0, 30.0)) and is_clear(unique(60.0))
    assert not is_clear(unique(60.0, 50.0)) and not is_clear(unique(20.0)) and not is_clear(unique())
    assert not is_clear(answer((60.0, HERE))) and not is_strong(unique(45.0))
    assert is_strong(unique(60.0, 55.0)) and not is_overwhelming(unique(90.0)) and is_overwhelming(unique(110.0, 80.0))


def test_an_answer_confirms_another_when_map_and_evidence_have_grown() -> None:
    first = UniqueMatch(None, np.zeros(3), 50.0, MapSize(2, 40.0), 9)
    assert UniqueMatch(None, np.zeros(3), 60.0, MapSize(3, 41.0), 10).has_more_evidence_than(first)
    assert not UniqueMatch(None, np.zeros(3), 60.0, MapSize(2, 41.0), 10).has_more_evidence_than(first)
    assert not UniqueMatch(None, np.zeros(3), 50.0, MapSize(3, 60.0), 12).has_more_evidence_than(first)
