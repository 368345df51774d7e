"""Storey hypotheses: by the heights between floors, and by one place at which all floors are explained."""

import numpy as np
import pytest

from data import Floor, Room, SceneGraph, WallSurface
from matching import Hypothesis, MatchResult
from sgslam.anchoring.storey_hypotheses import Assignment, JointMatch, assignments, match_jointly

PLANNED = tuple(Floor(name, name, z) for name, z in (("cellar", -3.0), ("ground", 0.0), ("first", 3.0), ("top", 6.5)))
LOW_HIGH = (Floor("low", "", 0.0), Floor("high", "", 3.0))
Place = tuple[float, float, float]
HERE, THERE = (0.0, 5.0, 5.0), (0.0, 30.0, 5.0)


@pytest.mark.parametrize(
    ("climbed", "planned", "start", "expected"),
    [
        ((0.0,), PLANNED, None, ["cellar", "ground", "first", "top"]),
        ((0.0, 3.1), PLANNED, None, ["cellar ground", "ground first", "first top"]),
        ((0.0, -6.0), PLANNED, None, ["first cellar", "top ground"]),
        ((0.0, 3.1, 6.0), PLANNED, "cellar", ["cellar ground first"]),
        ((0.0, 3.1), PLANNED, "top", []),  # there is nothing above
        ((0.0, 3.59), LOW_HIGH, None, ["low high"]),  # six decimetres off the plan
        ((0.0, 3.61), LOW_HIGH, None, []),
        ((0.0, 2.41), LOW_HIGH, None, ["low high"]),
        ((0.0, 2.39), LOW_HIGH, None, []),
        ((0.0, 0.59), LOW_HIGH, None, ["low low", "high high"]),
        ((0.0, 0.6), LOW_HIGH, None, []),
        ((0.0, 3.1), (*PLANNED, Floor("attic")), None, None),  # without elevations only the start is known
        ((0.0,), (), None, None),
        ((0.0, 3.0), (Floor("a"), Floor("b", "", 0.0)), "a", ["a"]),
    ],
)
def test_storeys_follow_from_the_height_climbed(
    climbed: tuple[float, ...], planned: tuple[Floor, ...], start: str | None, expected: list[str] | None
) -> None:
    found = assignments(dict(enumerate(climbed)), planned, start)
    assert found == (expected if expected is None else [dict(enumerate(way.split())) for way in expected])


def floor_graph(storey: int) -> SceneGraph:
    walls = tuple(WallSurface(f"w{k}f{storey}", None, (float(k), 0.0), (0.0, 1.0), 1.0) for k in range(6))
    return SceneGraph("map", (Room(f"r{storey}", (2.0, 1.0)),), walls)


GRAPHS = {0: floor_graph(0), 1: floor_graph(1)}
NOTHING = MatchResult("none", "nothing")


def listed(*hypotheses: tuple[float, Place], status: str = "unique") -> MatchResult:
    places = tuple(Hypothesis(score, T, None) for score, T in hypotheses)
    return MatchResult(status, "", T_a_s=max(hypotheses)[1], hypotheses=places)  # type: ignore[arg-type]


def jointly(*answers: dict[str, MatchResult]) -> JointMatch | None:
    """Of each floor the answers by storey; they are possible in pairs, in their order."""
    possible: list[Assignment] = [dict(enumerate(way)) for way in zip(*answers, strict=True)]
    return match_jointly(GRAPHS, possible, lambda number, storey: answers[number][storey])


@pytest.mark.parametrize(("other", "decided"), [(100.0, True), (100.1, False)])
def test_an_assignment_wins_by_eight_nats_and_a_tenth(other: float, decided: bool) -> None:
    """Of 120 nats; equal storeys are told apart by a floor that differs."""
    sixty = listed((60.0, HERE))
    found = jointly({"a": sixty, "b": listed((50.0, HERE))}, {"b": sixty, "c": listed((other - 50.0, HERE))})
    assert (found is not None) is decided
    if found is not None:
        assert found.assigned == {0: "a", 1: "b"} and found.answers == {0: sixty, 1: sixty}


def turned(degrees: float) -> Place:
    """A place that is turned about the centroid of the upper floor."""
    (cx, cy), yaw = GRAPHS[1].centroid(), np.radians(degrees)
    x, y = 5.0 + cx - np.cos(yaw) * cx + np.sin(yaw) * cy, 5.0 + cy - np.sin(yaw) * cx - np.cos(yaw) * cy
    return float(yaw), float(x), float(y)


TEN = tuple((50.0, (0.0, 50.0 + 10.0 * k, 5.0)) for k in range(10))  # other places; a longer list is cut off
FEW = tuple((score - 40.0 * (k > 0), T) for k, (score, T) in enumerate(TEN))


@pytest.mark.parametrize(
    ("lower", "upper", "decided"),
    [
        (listed((60.0, HERE)), listed((60.0, HERE)), True),
        (listed((60.0, HERE)), NOTHING, False),  # what lies above may be no storey of the plan
        (listed((60.0, HERE)), listed((60.0, (0.0, 5.75, 5.0))), True),  # floors of one map lie at one place
        (listed((60.0, HERE)), listed((60.0, (0.0, 5.76, 5.0))), False),
        (listed((60.0, HERE)), listed((60.0, turned(4.9))), True),
        (listed((60.0, HERE)), listed((60.0, turned(5.1))), False),
        (listed((60.0, HERE), (50.0, THERE)), listed((60.0, HERE), (50.0, THERE)), True),  # another place of both
        (listed((60.0, HERE), (50.5, THERE)), listed((60.0, HERE), (50.5, THERE)), False),
        # of the hypotheses at a place the best one counts
        (listed((60.0, HERE), (50.0, THERE)), listed((60.0, HERE), (20.0, (0.0, 5.6, 5.0)), (50.0, THERE)), True),
        # a place beyond a full list may be as good as the last one of it
        (listed((60.0, HERE), *TEN[:8]), listed((60.0, HERE), (55.0, (0.0, 5.0, 90.0))), True),
        (listed((60.0, HERE), *TEN[:9]), listed((60.0, HERE), (55.0, (0.0, 5.0, 90.0))), False),
        (listed((90.0, HERE)), listed(*FEW), False),  # but is no answer
        (listed((60.0, HERE)), listed((60.0, HERE), status="ambiguous"), True),  # one floor must be sure
        (listed((60.0, HERE), status="ambiguous"), listed((60.0, HERE)), True),
        (listed((60.0, HERE), status="ambiguous"), listed((60.0, HERE), status="ambiguous"), False),
        (listed((60.0, HERE)), listed((60.0, HERE), status="none"), False),  # and none without an answer
        (listed((60.0, HERE)), listed((60.0, (np.radians(5.1), 5.0, 5.0)), (60.0, HERE)), True),
    ],
)
def test_all_floors_are_explained_at_one_place(lower: MatchResult, upper: MatchResult, decided: bool) -> None:
    assert (jointly({"a": lower}, {"b": upper}) is not None) is decided
