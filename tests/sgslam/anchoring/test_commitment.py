"""When a map has grown, when an answer is sure, and what a committed match and the log of anchors remember."""

import logging
from dataclasses import replace

import numpy as np
import pytest

from data import Keyframe, Room, SceneGraph, WallSurface
from matching import MatchResult
from matching.result import Hypothesis
from sgslam.anchoring.anchor_log import AnchorLog, AnchorStatus
from sgslam.anchoring.floor_matching import FloorMatching, PlacedMatch
from sgslam.anchoring.match_history import Commitment, MapSize, UniqueMatch
from sgslam.anchoring.place_verification import Plan
from sgslam.config import AnchorSettings, Config
from sgslam.mapping import Scene, WallMap

WALL = WallSurface("s", None, (0.0, 0.0), (1.0, 0.0), 2.0)
HERE = (0.0, 0.0, 0.0)
TIGHT = AnchorStatus("tight", "match 1", "as planned within 30 mm")
LOOSE = AnchorStatus("loose", "position", "+120 mm off the plan")


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


@pytest.mark.parametrize(("score", "rooms", "more"), [(50.1, 3, True), (50.0, 3, False), (50.1, 2, False)])
def test_an_answer_has_more_evidence_when_the_map_has_grown_too(score: float, rooms: int, more: bool) -> None:
    now, before = (UniqueMatch(None, np.zeros(3), nats, MapSize(k, 40.0), 9) for nats, k in ((score, rooms), (50.0, 2)))
    assert now.has_more_evidence_than(before) is more
    assert not before.is_confirmable(14) and before.is_confirmable(15)  # six keyframes later


def test_a_commitment_is_as_sure_as_its_worst_wall_and_placed_by_the_back_end() -> None:
    own, walls, T_map_local = Commitment(), WallMap(Config().surfaces), np.eye(4)
    own.other_confidence = 0.4
    assert own.confidence == 0.4 and own.floor is None
    match = MatchResult("unique", "", (), (("s", "a", 0.9), ("t", "b", 0.7)), floor="up")
    own.commit(match, np.array([0.0, 5.0, 6.0]), Scene(SceneGraph("map", (), (WALL,)), {"s": 7, "t": 8}, [], {}))
    assert own.confidence == 0.7 and own.floor == "up" and own.pairs == {(7, "a"), (8, "b")}
    T_map_local[:2, 3] = -1.0, -2.0
    assert own.place_now(walls, T_map_local) == pytest.approx([0.0, 1.0, 2.0])
    assert own.place_now(walls, None) == pytest.approx([0.0, 5.0, 6.0])
    own.replaced = True  # the back end's place is still that of a match that was withdrawn
    assert own.place_now(walls, T_map_local) == pytest.approx([0.0, 5.0, 6.0])
    own.clear()
    assert (own.match, own.pairs, own.confidence) == (None, set(), 0.4)


def scene(keyframes: int, rooms: int = 1) -> Scene:
    graph = SceneGraph(
        "map", tuple(Room(f"r{k}", (0.0, 0.0)) for k in range(rooms)),
        tuple(replace(WALL, id=f"s{k}") for k in range(10)),
        keyframes=tuple(Keyframe(f"k{k}", k, (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)) for k in range(keyframes)),
    )  # fmt: skip
    return Scene(graph, {}, [], {})


def answered(pairs: int = 8, place: tuple[float, float, float] = HERE, by_room: bool = False) -> PlacedMatch:
    """A unique answer without hypotheses, so one that is not clear, and of no known evidence."""
    match = MatchResult("unique", "", (), tuple((f"s{k}", f"a{k}", 1.0) for k in range(pairs)), T_a_s=place)
    return PlacedMatch(match, np.array(place), by_room)


Confirmed = tuple[int, int, int, tuple[float, float, float]]


def matching(partial: bool = False, planned: int = 10) -> FloorMatching:
    plan = Plan(SceneGraph("bim", (), tuple(replace(WALL, id=f"a{k}") for k in range(planned))), partial)
    return FloorMatching(plan, None, AnchorSettings())  # type: ignore[arg-type]  # nothing is asked of it


@pytest.mark.parametrize(
    ("others", "partial", "rejected"),
    [
        ([(88.1, (0.0, 3.0, 0.0), "eg")], False, True),
        ([(87.9, (0.0, 3.0, 0.0), "eg")], False, False),
        ([(99.0, (0.0, 0.99, 0.0), "eg")], False, False),
        ([(99.0, (0.0, 1.01, 0.0), "eg")], False, True),
        ([(99.0, HERE, "og")], False, True),  # on another storey
        ([(99.0, (0.0, 3.0, 0.0), "eg")], True, False),  # a partial plan has rules of its own
        ([], False, False),
    ],
)
def test_an_answer_is_rejected_where_another_place_has_nearly_its_evidence(
    others: list[tuple[float, tuple[float, float, float], str]], partial: bool, rejected: bool
) -> None:
    asked = matching(partial)
    hypotheses = tuple(Hypothesis(score, T, floor, ()) for score, T, floor in [(100.0, HERE, "eg"), *others])
    asked.match = MatchResult("unique", "", T_a_s=HERE, floor="eg", hypotheses=hypotheses)
    assert asked.reject_nearly_equal(scene(1)) is bool(asked.rejection) is rejected


@pytest.mark.parametrize(
    ("sure", "unsure"),  # pairs, walls of the plan, keyframes, place
    [
        ((8, 10, 16, HERE), (8, 10, 15, HERE)),  # six keyframes later
        ((7, 7, 16, HERE), (7, 10, 16, HERE)),  # with eight walls, or all of the plan
        ((8, 10, 16, (0.0, 1.0, 0.0)), (8, 10, 16, (0.0, 1.01, 0.0))),  # at the same place
        ((8, 10, 16, (0.087, 0.0, 0.0)), (8, 10, 16, (-0.088, 0.0, 0.0))),  # and with the same heading
    ],
)
def test_an_answer_that_is_not_clear_waits_for_a_larger_map_to_confirm_it(sure: Confirmed, unsure: Confirmed) -> None:
    for case in (sure, unsure):
        pairs, planned, keyframes, place = case
        own = matching(planned=planned)
        assert not own.is_sure(answered(pairs), scene(10), last=False)
        assert own.is_sure(answered(pairs, place), scene(keyframes), last=False) is (case is sure)


def test_the_last_answer_is_sure_with_a_complete_plan_and_one_by_a_room_when_the_map_has_grown() -> None:
    assert matching().is_sure(answered(), scene(10), last=True)
    assert not matching(partial=True).is_sure(answered(), scene(10), last=True)
    own = matching(partial=True)
    sure = [own.is_sure(answered(by_room=True), seen, last=False) for seen in (scene(10), scene(30), scene(11, 2))]
    assert sure == [False, False, True]


def states(log: AnchorLog) -> dict[tuple[int, str], list[str]]:
    return {(r.wall, r.a_id): [e.state for e in r.events] for r in log.records}


def test_an_anchor_keeps_its_origin_and_all_its_states(caplog: pytest.LogCaptureFixture) -> None:
    log = AnchorLog()
    with caplog.at_level(logging.INFO, "sgslam"):
        log.update(10, {(1, "a"): TIGHT, (2, "b"): LOOSE, (4, "b"): LOOSE})
        log.rename(lambda wall: 2 if wall == 4 else wall)  # joined walls keep one record
        log.update(20, {(1, "a"): TIGHT, (2, "b"): AnchorStatus("tight", "match 2", "closer now")})
        log.update(30, {(1, "a"): AnchorStatus("loose", "position", "+90 mm off the plan")})
    assert states(log) == {(1, "a"): ["tight", "loose"], (2, "b"): ["loose", "tight", "withdrawn"]}
    assert caplog.text.count("anchor w1 to a, by match 1: tight") == 1
    first = log.records[0]
    assert first.by == "match 1" and [e.stamp_ns for e in first.events] == [10, 30]
    assert first.to_dict()["events"][1] == {"stamp_ns": 30, "state": "loose", "why": "+90 mm off the plan"}
    log.withdraw_all(40, "match 2 places the map elsewhere")
    log.withdraw_all(50, "once more")
    assert [(r.state, r.events[-1].stamp_ns) for r in log.records] == [("withdrawn", 40), ("withdrawn", 30)]
    log.update(60, {(2, "b"): TIGHT})
    assert [r.state for r in log.records] == ["withdrawn", "tight"]
