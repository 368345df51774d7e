"""Scores of a matcher's answer by the contract, and when a unique answer is wrong."""

import dataclasses
from typing import Any

import numpy as np
import pytest
from plans import a_graph, flat

from data import Room, SceneGraph, WallSurface
from data.common.errors import UserError
from data.synthetic_maps.noise_models import draw
from evaluation.metrics.matches import matching_scores, unique_is_wrong
from evaluation.metrics.statistics import Score
from evaluation.metrics.true_matches import TrueMatches, true_matches
from matching import Matcher
from matching.result import MatchResult
from sgslam.geometry.frames import se2_to_se3

pytestmark = pytest.mark.slow


def wall(name: str, length: float | None) -> WallSurface:
    return WallSurface(name, "R1", (0.0, 0.0), (1.0, 0.0), length)


def square(name: str, side: float) -> Room:
    return Room(name, (0.0, 0.0), polygon=((0.0, 0.0), (side, 0.0), (side, side), (0.0, side)))


S = SceneGraph(
    "map", (square("R1", 4), square("R2", 3), square("R3", 2)),
    (wall("long", 3.0), wall("short", 1.0), wall("other", 2.0), wall("cupboard", 1.5)),
)  # fmt: skip
# R2 and R3 are parts of one room, `long` and `short` pieces of one wall; the cupboard is in no plan.
TRUTH = TrueMatches(
    {"R1": "A1", "R2": "A2", "R3": "A2"}, {"long": "a", "short": "a", "other": "b"}, (0.5, 10.0, 20.0), "ground",
    (100.0, 0.0),
)  # fmt: skip


def answer(rooms: str = "", walls: str = "", **changes: Any) -> MatchResult:
    """`R1-A1 R2-A2` as an answer."""
    pairs: list[Any] = [tuple((*pair.split("-"), 0.9) for pair in text.split()) for text in (rooms, walls)]
    known: dict[str, Any] = {"status": "unique", "reason": "", "T_a_s": TRUTH.T_a_s, "floor": "ground"}
    return MatchResult(rooms=pairs[0], wall_surfaces=pairs[1], **known | changes)


@pytest.mark.parametrize(
    ("walls", "score"),
    [
        ("long-a short-a other-b", Score(2, 2, 2, 2)),
        ("long-a other-b", Score(2, 2, 2, 2)),
        ("long-a short-b other-b", Score(2, 2, 2, 2)),  # a shorter piece counts neither way
        ("short-a other-b", Score(1, 1, 1, 2)),
        ("long-b short-a", Score(0, 1, 0, 2)),
        ("long-a cupboard-a", Score(1, 2, 1, 2)),  # what has no true match is wrong wherever it is put
        ("", Score(0, 0, 0, 2)),
    ],
)
def test_wall_surfaces_by_the_contract(walls: str, score: Score) -> None:
    assert matching_scores(answer("", walls), TRUTH, S).wall_surfaces == score


@pytest.mark.parametrize(
    ("rooms", "score"),
    [
        ("R1-A1 R2-A2", Score(2, 2, 2, 2)),
        ("R1-A1 R2-A2 R3-A1", Score(2, 2, 2, 2)),
        ("R1-A2 R3-A2", Score(0, 1, 0, 2)),
    ],
)
def test_rooms_by_the_contract(rooms: str, score: Score) -> None:
    assert matching_scores(answer(rooms), TRUTH, S).rooms == score


def test_the_pairs_count_whatever_the_status() -> None:
    given = answer("R1-A1", "long-a")
    undecided = dataclasses.replace(given, status="ambiguous")
    assert matching_scores(given, TRUTH, S) == matching_scores(undecided, TRUTH, S)


def test_shares_of_a_score() -> None:
    score = Score(3, 4, 3, 6)
    assert (score.precision, score.recall, score.f1) == (0.75, 0.5, pytest.approx(0.6))
    nothing = Score(0, 0, 0, 6)
    assert (nothing.precision, nothing.recall, nothing.f1) == (None, 0, 0)
    assert Score(0, 0, 0, 0).f1 is None and Score(0, 2, 0, 0).f1 is None


def test_answers_of_another_graph_or_twice_are_refused() -> None:
    for given, message in (
        (answer("", "long-a long-b"), "'long' is answered twice"),
        (answer("", "roof-a"), "no wall surface 'roof'"),
        (answer("R9-A1"), "no room 'R9'"),
    ):
        with pytest.raises(UserError, match=message):
            matching_scores(given, TRUTH, S)
    with pytest.raises(UserError, match="no room 'R2'"):
        matching_scores(answer(), TRUTH, dataclasses.replace(S, rooms=S.rooms[:1]))


def placed(off_m: float, turned_deg: float) -> tuple[float, float, float]:
    """A motion that is wrong by so much at the S-graph's centroid, 100 m from its origin."""
    yaw, x, y = TRUTH.T_a_s
    turned = yaw + np.radians(turned_deg)
    arm = 100 * np.array([np.cos(yaw) - np.cos(turned), np.sin(yaw) - np.sin(turned)])
    return float(turned), float(x + arm[0] + 0.6 * off_m), float(y + arm[1] - 0.8 * off_m)


@pytest.mark.parametrize(
    ("off_m", "turned_deg", "wrong", "wrong_if_bent"),
    [
        (0.0, 0.0, False, False), (0.49, 4.9, False, False), (0.51, 0.0, True, False), (0.0, 5.1, True, False),
        (0.0, -5.1, True, False), (0.99, -7.9, True, False), (1.01, 0.0, True, True), (0.0, 8.1, True, True),
        (0.0, 180.0, True, True), (0.0, 359.0, False, False), (float("nan"), 0.0, True, True),
    ],
)  # fmt: skip
def test_a_unique_answer_is_wrong_by_its_motion(
    off_m: float, turned_deg: float, wrong: bool, wrong_if_bent: bool
) -> None:
    given = answer("R1-A1", T_a_s=placed(off_m, turned_deg))
    assert unique_is_wrong(given, TRUTH) is wrong
    assert unique_is_wrong(given, TRUTH, bent=True) is wrong_if_bent


@pytest.mark.parametrize(
    ("given", "wrong"),
    [
        (answer("R1-A1 R2-A2 R3-A2"), False),
        (answer("R1-A1 R3-A1"), True),
        (answer("R1-A1", floor="first"), True),
        (answer("R1-A1", floor=None), True),
        (answer("R1-A1", "long-b"), False),  # single walls are the scores' matter
        (answer("R9-A1"), True),
        (answer("R1-A2", status="ambiguous"), False),
    ],
)
def test_a_unique_answer_is_wrong_by_its_floor_or_one_room(given: Any, wrong: bool) -> None:
    assert unique_is_wrong(given, TRUTH) is wrong


def test_a_unique_answer_without_a_motion_is_refused() -> None:
    with pytest.raises(UserError, match="no T_a_s"):
        unique_is_wrong(answer(T_a_s=None), TRUTH)


def test_the_matcher_on_a_drawn_map_and_the_same_answer_against_a_wrong_place() -> None:
    plan = a_graph(flat(np.random.default_rng(3)), "ground")
    drawn = draw(plan, "real", np.random.default_rng(1), 6)
    result = Matcher.load().match(drawn.s_graph, plan)
    truth = true_matches(drawn.s_graph, plan, se2_to_se3(*drawn.T_a_s))
    scores = matching_scores(result, truth, drawn.s_graph)
    assert result.status == "unique" and not unique_is_wrong(result, truth)
    assert scores.rooms.f1 == 1 and scores.wall_surfaces.f1 is not None and scores.wall_surfaces.f1 > 0.85
    yaw, x, y = drawn.T_a_s
    assert unique_is_wrong(result, true_matches(drawn.s_graph, plan, se2_to_se3(yaw + np.pi, x, y)))
