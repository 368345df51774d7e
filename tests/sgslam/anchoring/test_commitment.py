"""When a map has grown, when an answer confirms an earlier one, and what a committed match remembers."""

from dataclasses import replace

import numpy as np
import pytest

from data import Keyframe, Room, SceneGraph, WallSurface
from matching import MatchResult
from matching.result import Hypothesis
from sgslam.anchoring.floor_matching import FloorMatching, PlacedMatch
from sgslam.anchoring.match_history import Commitment, MapSize, UniqueMatch
from sgslam.anchoring.place_verification import Plan
from sgslam.config import AnchorSettings, Config
from sgslam.mapping import Scene, WallMap

WALL = WallSurface("s", None, (0.0, 0.0), (1.0, 0.0), 2.0)
SCENE = Scene(SceneGraph("map", (), (WALL,)), {"s": 7, "t": 8}, [], {})


@pytest.mark.parametrize(
    ("rooms", "length", "grown"),
    [(2, 44.0, False), (2, 44.1, True), (3, 40.0, True), (3, 1.0, True), (1, 44.0, False)],
)
def test_a_map_has_grown_by_a_room_or_a_tenth_of_its_walls(rooms: int, length: float, grown: bool) -> None:
    assert MapSize(rooms, length).has_grown_since(MapSize(2, 40.0)) is grown


def test_the_size_of_a_map_counts_rooms_and_known_lengths() -> None:
    walls = (WALL, replace(WALL, id="t", length=None), replace(WALL, id="u", length=3.5))
    assert MapSize.of(SceneGraph("map", (Room("r", (0.0, 0.0)),), walls)) == MapSize(1, 5.5)
    assert not MapSize().has_grown_since(MapSize())


def earlier(score: float = 50.0, rooms: int = 2, keyframes: int = 9) -> UniqueMatch:
    return UniqueMatch(None, np.zeros(3), score, MapSize(rooms, 40.0), keyframes)


def test_an_answer_is_confirmed_six_keyframes_later() -> None:
    assert not earlier().is_confirmable(14) and earlier().is_confirmable(15)


def test_an_answer_confirms_another_when_map_and_evidence_have_grown() -> None:
    assert earlier(50.1, rooms=3).has_more_evidence_than(earlier())
    assert not earlier(50.0, rooms=3).has_more_evidence_than(earlier())
    assert not earlier(50.1).has_more_evidence_than(earlier())


def test_the_confidence_is_that_of_the_worst_wall() -> None:
    own = Commitment()
    own.other_confidence = 0.4
    assert own.confidence == 0.4 and own.floor is None
    own.commit(MatchResult("unique", "", (), (("s", "a", 0.9), ("t", "b", 0.7)), floor="up"), np.ones(3), SCENE)
    assert own.confidence == 0.7 and own.floor == "up" and own.pairs == {(7, "a"), (8, "b")}
    own.clear()
    assert (own.match, own.pairs, own.confidence) == (None, set(), 0.4)


def test_a_place_is_the_back_ends_unless_it_has_none_or_that_of_a_withdrawn_match() -> None:
    own, walls = Commitment(), WallMap(Config().surfaces)
    own.place = np.array([0.0, 5.0, 6.0])
    T_map_local = np.eye(4)
    T_map_local[:2, 3] = -1.0, -2.0
    assert own.place_now(walls, T_map_local) == pytest.approx([0.0, 1.0, 2.0])
    assert own.place_now(walls, None) == pytest.approx([0.0, 5.0, 6.0])
    own.replaced = True
    assert own.place_now(walls, T_map_local) == pytest.approx([0.0, 5.0, 6.0])


def scene(keyframes: int, walls: int = 10, rooms: int = 1) -> Scene:
    graph = SceneGraph(
        "map", tuple(Room(f"r{k}", (0.0, 0.0)) for k in range(rooms)),
        tuple(replace(WALL, id=f"s{k}") for k in range(walls)),
        keyframes=tuple(Keyframe(f"k{k}", k, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)) for k in range(keyframes)),
    )  # fmt: skip
    return Scene(graph, {}, [], {})


def answered(pairs: int = 8, place: tuple[float, float, float] = (0.0, 0.0, 0.0), by_room: bool = False) -> PlacedMatch:
    """A unique answer without hypotheses, so one that is not clear, and of no known evidence."""
    match = MatchResult("unique", "", (), tuple((f"s{k}", f"a{k}", 1.0) for k in range(pairs)), T_a_s=place)
    return PlacedMatch(match, np.array(place), by_room)


def matching(partial: bool = False, planned: int = 10) -> FloorMatching:
    plan = Plan(SceneGraph("bim", (), tuple(replace(WALL, id=f"a{k}") for k in range(planned))), partial)
    return FloorMatching(plan, None, AnchorSettings())  # type: ignore[arg-type]  # nothing is asked of it


@pytest.mark.parametrize(
    ("score", "place", "floor", "partial", "rejected"),
    [
        (88.1, (0.0, 3.0, 0.0), "eg", False, True), (87.9, (0.0, 3.0, 0.0), "eg", False, False),
        (99.0, (0.0, 0.99, 0.0), "eg", False, False), (99.0, (0.0, 1.01, 0.0), "eg", False, True),  # the same place
        (99.0, (0.0, 0.0, 0.0), "og", False, True),  # on another storey
        (99.0, (0.0, 3.0, 0.0), "eg", True, False),  # a partial plan has rules of its own
    ],
)  # fmt: skip
def test_an_answer_is_rejected_where_another_place_has_nearly_its_evidence(
    score: float, place: tuple[float, float, float], floor: str, partial: bool, rejected: bool
) -> None:
    asked = matching(partial)
    hypotheses = (Hypothesis(100.0, (0.0, 0.0, 0.0), "eg", ()), Hypothesis(score, place, floor, ()))
    asked.match = MatchResult("unique", "", T_a_s=(0.0, 0.0, 0.0), floor="eg", hypotheses=hypotheses)
    assert asked.reject_nearly_equal(SCENE) is rejected
    assert bool(asked.rejection) is rejected


def test_an_answer_without_hypotheses_has_no_rival() -> None:
    asked = matching()
    asked.match = answered().match
    assert not asked.reject_nearly_equal(SCENE)


@pytest.mark.parametrize(
    ("pairs", "planned", "keyframes", "place", "sure"),
    [
        (8, 10, 16, (0.0, 0.0, 0.0), True), (8, 10, 15, (0.0, 0.0, 0.0), False),  # six keyframes later
        (7, 10, 16, (0.0, 0.0, 0.0), False), (7, 7, 16, (0.0, 0.0, 0.0), True),  # with eight walls, or all of the plan
        (8, 10, 16, (0.0, 1.0, 0.0), True), (8, 10, 16, (0.0, 1.01, 0.0), False),  # at the same place
        (8, 10, 16, (0.087, 0.0, 0.0), True), (8, 10, 16, (-0.088, 0.0, 0.0), False),  # and with the same heading
    ],
)  # fmt: skip
def test_an_answer_that_is_not_clear_waits_for_a_larger_map_to_confirm_it(
    pairs: int, planned: int, keyframes: int, place: tuple[float, float, float], sure: bool
) -> None:
    own = matching(planned=planned)
    assert not own.is_sure(answered(pairs), scene(10), last=False)
    assert own.is_sure(answered(pairs, place), scene(keyframes), last=False) is sure


def test_the_last_answer_of_a_run_is_sure_with_a_complete_plan_only() -> None:
    assert matching().is_sure(answered(), scene(10), last=True)
    assert not matching(partial=True).is_sure(answered(), scene(10), last=True)


def test_an_answer_by_a_room_is_confirmed_by_a_map_that_has_grown() -> None:
    own = matching(partial=True)
    assert not own.is_sure(answered(by_room=True), scene(10), last=False)
    assert not own.is_sure(answered(by_room=True), scene(30), last=False)
    assert own.is_sure(answered(by_room=True), scene(11, rooms=2), last=False)
