"""The log of anchors and the reasons for their states."""

import logging

import pytest

from sgslam.anchoring.anchor_log import AnchorLog, AnchorStatus

TIGHT = AnchorStatus("tight", "match 1", "as planned within 30 mm")
LOOSE = AnchorStatus("loose", "position", "+120 mm off the plan")


def states(log: AnchorLog) -> dict[tuple[int, str], list[str]]:
    return {(r.wall, r.a_id): [e.state for e in r.events] for r in log.records}


def test_an_anchor_keeps_its_origin_and_all_its_states() -> None:
    log = AnchorLog()
    log.update(10, {(1, "a"): TIGHT, (2, "b"): LOOSE})
    log.update(20, {(1, "a"): TIGHT, (2, "b"): AnchorStatus("tight", "match 2", "closer now")})
    log.update(30, {(1, "a"): AnchorStatus("loose", "position", "+90 mm off the plan")})
    assert states(log) == {(1, "a"): ["tight", "loose"], (2, "b"): ["loose", "tight", "withdrawn"]}
    first = log.records[0]
    assert first.by == "match 1" and [e.stamp_ns for e in first.events] == [10, 30]
    assert first.to_dict()["events"][1] == {"stamp_ns": 30, "state": "loose", "why": "+90 mm off the plan"}


def test_a_withdrawn_match_takes_all_anchors_with_it() -> None:
    log = AnchorLog()
    log.update(10, {(1, "a"): TIGHT, (2, "b"): LOOSE})
    log.withdraw_all(20, "match 2 places the map elsewhere")
    log.withdraw_all(30, "once more")
    assert all(r.state == "withdrawn" and r.events[-1].stamp_ns == 20 for r in log.records)
    log.update(40, {(2, "b"): TIGHT})
    assert states(log) == {(1, "a"): ["tight", "withdrawn"], (2, "b"): ["loose", "withdrawn", "tight"]}


def test_joined_walls_keep_one_record() -> None:
    log = AnchorLog()
    log.update(10, {(1, "a"): TIGHT, (2, "a"): LOOSE, (3, "b"): TIGHT})
    log.rename(lambda wall: 1 if wall == 2 else wall)
    assert states(log) == {(1, "a"): ["tight"], (3, "b"): ["tight"]}


def test_every_change_is_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    log = AnchorLog()
    with caplog.at_level(logging.INFO, "sgslam"):
        for stamp in (10, 20, 30):
            log.update(stamp, {(1, "a"): TIGHT})
    assert caplog.text.count("anchor w1 to a, by match 1: tight") == 1
