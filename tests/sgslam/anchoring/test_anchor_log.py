"""What the log of anchors remembers."""

import logging

import pytest

from sgslam.anchoring.anchor_log import AnchorLog, AnchorStatus

TIGHT = AnchorStatus("tight", "match 1", "as planned within 30 mm")
LOOSE = AnchorStatus("loose", "match 3", "+120 mm off the plan")


def states(log: AnchorLog) -> dict[tuple[int, str], list[str]]:
    return {(r.wall, r.a_id): [e.state for e in r.events] for r in log.records}


def test_an_anchor_keeps_its_origin_and_all_its_states(caplog: pytest.LogCaptureFixture) -> None:
    log = AnchorLog()
    with caplog.at_level(logging.INFO, "sgslam"):
        log.update(10, {(1, "a"): TIGHT, (2, "b"): LOOSE, (4, "b"): LOOSE})
        log.rename(lambda wall: 2 if wall == 4 else wall)  # joined walls keep one record
        log.update(20, {(1, "a"): TIGHT, (2, "b"): AnchorStatus("tight", "match 2", "closer now")})
        log.update(30, {(1, "a"): AnchorStatus("loose", "match 3", "+90 mm off the plan")})
    assert states(log) == {(1, "a"): ["tight", "loose"], (2, "b"): ["loose", "tight", "withdrawn"]}
    assert caplog.text.count("anchor w1 to a, by match 1: tight") == 1
    first = log.records[0]
    assert first.by == "match 1" and [e.stamp_ns for e in first.events] == [10, 30]
    assert first.to_dict()["events"][1] == {"stamp_ns": 30, "state": "loose", "why": "+90 mm off the plan"}
    log.update(40, {}, "match 2 places the map elsewhere")
    log.update(50, {}, "once more")
    assert [(r.state, r.events[-1].stamp_ns) for r in log.records] == [("withdrawn", 40), ("withdrawn", 30)]
    log.update(60, {(2, "b"): TIGHT})
    assert [r.state for r in log.records] == ["withdrawn", "tight"]
