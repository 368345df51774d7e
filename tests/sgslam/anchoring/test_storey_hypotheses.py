"""Storey hypotheses: by the heights between floors, and by one place at which all floors are explained."""

from collections.abc import Callable

import numpy as np
import pytest

from data import Floor, Room, SceneGraph, WallSurface
from matching import Hypothesis, MatchResult
from sgslam.anchoring.storey_hypotheses import assignments, match_jointly

PLANNED = tuple(Floor(name, name, z) for name, z in (("cellar", -3.0), ("ground", 0.0), ("first", 3.0), ("top", 6.5)))


def test_storeys_are_told_by_the_height_climbed() -> None:
    assert assignments({0: 0.0}, PLANNED, None) == [{0: f.id} for f in PLANNED]
    climbed = assignments({0: 0.0, 1: 3.1}, PLANNED, None)
    assert climbed == [{0: "cellar", 1: "ground"}, {0: "ground", 1: "first"}, {0: "first", 1: "top"}]
    assert assignments({0: 0.0, 1: -6.0}, PLANNED, None) == [{0: "first", 1: "cellar"}, {0: "top", 1: "ground"}]
    assert assignments({0: 0.0, 1: 3.1, 2: 6.0}, PLANNED, "cellar") == [{0: "cellar", 1: "ground", 2: "first"}]
    assert assignments({0: 0.0, 1: 3.1}, PLANNED, "top") == []  # there is nothing above
    assert assignments({0: 0.0, 1: 3.1}, (*PLANNED, Floor("attic")), None) is None


def floor_graph(storey: int) -> SceneGraph:
    walls = tuple(WallSurface(f"w{k}f{storey}", None, (float(k), 0.0), (0.0, 1.0), 1.0) for k in range(6))
    return SceneGraph("map", (Room(f"r{storey}", (2.0, 1.0)),), walls)


def answers(
    scores: dict[tuple[int, str], float], at: dict[tuple[int, str], tuple[float, float, float]] | None = None
) -> Callable[[int, str], MatchResult]:
    """A matcher of one floor with one storey that gives these scores, at these places."""

    def ask(number: int, storey: str) -> MatchResult:
        score = scores.get((number, storey), 0.0)
        T = (at or {}).get((number, storey), (0.0, 5.0, 5.0))
        if not score:
            return MatchResult("none", "nothing")
        return MatchResult("unique", "", T_a_s=T, floor=storey, hypotheses=(Hypothesis(score, T, storey),))

    return ask


def test_equal_storeys_are_told_apart_by_a_floor_that_differs() -> None:
    graphs, possible = {0: floor_graph(0), 1: floor_graph(1)}, [{0: "a", 1: "b"}, {0: "b", 1: "c"}]
    equal = {(0, "a"): 60.0, (0, "b"): 59.0, (1, "b"): 60.0, (1, "c"): 59.0}
    assert match_jointly(graphs, possible, answers(equal)) is None
    found = match_jointly(graphs, possible, answers({**equal, (1, "c"): 20.0}))
    assert found is not None and found.assigned == {0: "a", 1: "b"}


def test_one_storey_less_in_the_plan_decides_only_where_all_floors_are_explained() -> None:
    graphs, possible = {0: floor_graph(0), 1: floor_graph(1)}, [{0: "a", 1: "b"}]
    both = {(0, "a"): 60.0, (1, "b"): 60.0}
    found = match_jointly(graphs, possible, answers(both))
    assert found is not None and found.answers[1].floor == "b"
    # what lies above may be no storey of the plan
    assert match_jointly(graphs, possible, answers({(0, "a"): 60.0})) is None
    elsewhere = {(0, "a"): (0.0, 5.0, 5.0), (1, "b"): (0.0, 9.0, 5.0)}
    assert match_jointly(graphs, possible, answers(both, elsewhere)) is None  # floors of one map lie at one place


@pytest.mark.parametrize(("height", "found"), [(3.59, 1), (3.61, 0), (2.41, 1), (2.39, 0), (0.59, 2), (0.6, 0)])
def test_a_climb_may_be_six_decimetres_off_the_plan(height: float, found: int) -> None:
    planned = (Floor("low", "", 0.0), Floor("high", "", 3.0))
    assert len(assignments({0: 0.0, 1: height}, planned, None) or ()) == found


def test_without_elevations_only_the_start_is_known() -> None:
    assert assignments({0: 0.0}, (Floor("a"),), None) is None and assignments({0: 0.0}, (), None) is None
    assert assignments({0: 0.0, 1: 3.0}, (Floor("a"), Floor("b", "", 0.0)), "a") == [{0: "a"}]


GRAPHS, ONE_WAY = {0: floor_graph(0), 1: floor_graph(1)}, [{0: "a", 1: "b"}]
BOTH = {(0, "a"): 60.0, (1, "b"): 60.0}
HERE = (0.0, 5.0, 5.0)


@pytest.mark.parametrize(
    ("x", "degrees", "same"), [(5.75, 0.0, True), (5.76, 0.0, False), (5.0, 4.9, True), (5.0, 5.1, False)]
)
def test_floors_of_one_map_lie_at_one_place(x: float, degrees: float, same: bool) -> None:
    cx, cy = GRAPHS[1].centroid()
    yaw = np.radians(degrees)  # about the centroid of the floor
    turned = (x + cx - np.cos(yaw) * cx + np.sin(yaw) * cy, 5.0 + cy - np.sin(yaw) * cx - np.cos(yaw) * cy)
    found = match_jointly(GRAPHS, ONE_WAY, answers(BOTH, {(0, "a"): HERE, (1, "b"): (float(yaw), *map(float, turned))}))
    assert (found is not None) is same


@pytest.mark.parametrize(("other", "decided"), [(100.0, True), (100.1, False)])
def test_an_assignment_wins_by_eight_nats_and_a_tenth(other: float, decided: bool) -> None:
    possible = [*ONE_WAY, {0: "c", 1: "d"}]
    found = match_jointly(GRAPHS, possible, answers({**BOTH, (0, "c"): other - 50.0, (1, "d"): 50.0}))
    assert (found is not None) is decided


def listed(*hypotheses: tuple[float, tuple[float, float, float]], status: str = "unique") -> MatchResult:
    best = max(hypotheses)[1]
    return MatchResult(
        status, "", T_a_s=best, hypotheses=tuple(Hypothesis(score, T, None) for score, T in hypotheses)
    )  # type: ignore[arg-type]  # fmt: skip


def jointly(lower: MatchResult, upper: MatchResult) -> bool:
    return match_jointly(GRAPHS, ONE_WAY, lambda number, _: (lower, upper)[number]) is not None


def test_another_place_that_all_floors_have_too_is_an_alternative() -> None:
    there = (0.0, 30.0, 5.0)
    assert jointly(listed((60.0, HERE), (50.0, there)), listed((60.0, HERE), (50.0, there)))
    assert not jointly(listed((60.0, HERE), (50.5, there)), listed((60.0, HERE), (50.5, there)))


@pytest.mark.parametrize(("places", "decided"), [(9, True), (10, False)])
def test_a_place_beyond_a_full_list_may_be_as_good_as_the_last_one_of_it(places: int, decided: bool) -> None:
    far = [(50.0, (0.0, 50.0 + 10.0 * k, 5.0)) for k in range(places - 1)]
    assert jointly(listed((60.0, HERE), *far), listed((60.0, HERE), (55.0, (0.0, 5.0, 90.0)))) is decided


def test_the_best_of_a_floors_hypotheses_at_a_place_counts() -> None:
    there = (0.0, 30.0, 5.0)
    upper = listed((60.0, HERE), (20.0, (0.0, 5.6, 5.0)), (50.0, there))
    assert jointly(listed((60.0, HERE), (50.0, there)), upper)


def test_a_place_that_a_floor_does_not_have_is_no_answer() -> None:
    """Though its list is full, so that it may have it with less evidence."""
    far = [(50.0 - 40.0 * (k > 0), (0.0, 50.0 + 10.0 * k, 5.0)) for k in range(10)]
    assert not jointly(listed((90.0, HERE)), listed(*far))


def test_one_floor_must_be_sure_and_none_without_an_answer() -> None:
    sure, unsure = listed((60.0, HERE)), listed((60.0, HERE), status="ambiguous")
    assert jointly(sure, unsure) and jointly(unsure, sure)
    assert not jointly(unsure, unsure)
    assert not jointly(sure, listed((60.0, HERE), status="none"))
    turned = listed((60.0, (np.radians(5.1), 5.0, 5.0)), (60.0, HERE), status="unique")
    assert jointly(sure, turned)
