"""What a committed match and the log of anchors remember."""

import logging

import numpy as np
import pytest

from data import SceneGraph, WallSurface
from matching import MatchResult
from sgslam.anchoring.anchor_log import AnchorLog, AnchorStatus
from sgslam.anchoring.commitment import Commitment
from sgslam.config import Config
from sgslam.mapping import Scene, WallMap

WALL = WallSurface("s", None, (0.0, 0.0), (1.0, 0.0), 2.0)
TIGHT = AnchorStatus("tight", "match 1", "as planned within 30 mm")
LOOSE = AnchorStatus("loose", "position", "+120 mm off the plan")


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
