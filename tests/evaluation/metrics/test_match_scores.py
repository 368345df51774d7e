"""Scores of a matcher's answer by the contract, and when a unique answer is wrong."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from data import Room, SceneGraph, WallSurface
from data.common.errors import UserError
from evaluation.metrics.matches import matching_scores, unique_is_wrong
from evaluation.metrics.statistics import Score
from evaluation.metrics.true_matches import TrueMatches
from matching.result import MatchResult


def square(name: str, side: float) -> Room:
    return Room(name, (0.0, 0.0), polygon=((0.0, 0.0), (side, 0.0), (side, side), (0.0, side)))


LENGTHS = {"long": 3.0, "short": 1.0, "other": 2.0, "cupboard": 1.5}
PIECES = tuple(WallSurface(name, "R1", (0.0, 0.0), (1.0, 0.0), length) for name, length in LENGTHS.items())
S = SceneGraph("map", (square("R1", 4), square("R2", 3), square("R3", 2)), PIECES)
# R2 and R3 are parts of one room, `long` and `short` pieces of one wall; the cupboard is in no plan.
TRUE_ROOMS, TRUE_WALLS = {"R1": "A1", "R2": "A2", "R3": "A2"}, {"long": "a", "short": "a", "other": "b"}
TRUTH = TrueMatches(TRUE_ROOMS, TRUE_WALLS, (0.5, 10.0, 20.0), "ground", (100.0, 0.0))


def answer(rooms: str = "", walls: str = "", **changes: Any) -> MatchResult:
    """`R1-A1 R2-A2` as an answer."""
    pairs: list[Any] = [tuple((*pair.split("-"), 0.9) for pair in text.split()) for text in (rooms, walls)]
    known: dict[str, Any] = {"status": "unique", "reason": "", "T_a_s": TRUTH.T_a_s, "floor": "ground"}
    return MatchResult(rooms=pairs[0], wall_surfaces=pairs[1], **known | changes)


@pytest.mark.parametrize(
    ("rooms", "walls", "score"),
    [
        ("", "long-a short-a other-b", Score(2, 2, 2, 2)),
        ("", "long-a short-b other-b", Score(2, 2, 2, 2)),  # a shorter piece counts neither way
        ("", "short-a other-b", Score(1, 1, 1, 2)),
        ("", "long-b short-a", Score(0, 1, 0, 2)),
        ("", "long-a cupboard-a", Score(1, 2, 1, 2)),  # what has no true match is wrong wherever it is put
        ("", "", Score(0, 0, 0, 2)),
        ("R1-A1 R2-A2", "", Score(2, 2, 2, 2)),
        ("R1-A1 R2-A2 R3-A1", "", Score(2, 2, 2, 2)),
        ("R1-A2 R3-A2", "", Score(0, 1, 0, 2)),
    ],
)
def test_pairs_are_scored_by_the_contract_whatever_the_status(rooms: str, walls: str, score: Score) -> None:
    given = answer(rooms, walls)
    scores = matching_scores(given, TRUTH, S)
    assert (scores.rooms if rooms else scores.wall_surfaces) == score
    assert matching_scores(dataclasses.replace(given, status="ambiguous"), TRUTH, S) == scores


@pytest.mark.parametrize(
    ("given", "rooms", "message"),
    [
        (answer("", "long-a long-b"), S.rooms, "'long' is answered twice"),
        (answer("", "roof-a"), S.rooms, "no wall surface 'roof'"),
        (answer("R9-A1"), S.rooms, "no room 'R9'"),
        (answer(), S.rooms[:1], "no room 'R2'"),
    ],
)
def test_answers_of_another_graph_or_twice_are_refused(given: Any, rooms: tuple[Room, ...], message: str) -> None:
    with pytest.raises(UserError, match=message):
        matching_scores(given, TRUTH, dataclasses.replace(S, rooms=rooms))


def placed(off_m: float, turned_deg: float) -> tuple[float, float, float]:
    """A motion that is wrong by so much at the S-graph's centroid, 100 m from its origin."""
    yaw, x, y = TRUTH.T_a_s
    turned = yaw + np.radians(turned_deg)
    arm = 100 * np.array([np.cos(yaw) - np.cos(turned), np.sin(yaw) - np.sin(turned)])
    return float(turned), float(x + arm[0] + 0.6 * off_m), float(y + arm[1] - 0.8 * off_m)


@pytest.mark.parametrize(
    ("motions", "wrong", "wrong_if_bent"),  # metres and degrees off
    [
        ([(0.49, 4.9), (0.0, 359.0)], False, False),
        ([(0.51, 0.0), (0.0, 5.1), (0.99, -7.9)], True, False),
        ([(1.01, 0.0), (0.0, 8.1), (0.0, 180.0), (float("nan"), 0.0)], True, True),
    ],
)
def test_a_unique_answer_is_wrong_by_its_motion(
    motions: list[tuple[float, float]], wrong: bool, wrong_if_bent: bool
) -> None:
    for motion in motions:
        given = answer("R1-A1", T_a_s=placed(*motion))
        assert unique_is_wrong(given, TRUTH) is wrong
        assert unique_is_wrong(given, TRUTH, warped=True) is wrong_if_bent


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
    with pytest.raises(UserError, match="no T_a_s"):
        unique_is_wrong(dataclasses.replace(given, T_a_s=None, status="unique"), TRUTH)
