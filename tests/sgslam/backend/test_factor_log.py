"""The factor log: origin and reason of each factor; and the graph rebuilt from it after optimizer failures."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from boxes import Array, pose
from gtsam.symbol_shorthand import X
from two_rooms import CONFIG, Run, anchors_of

import factors
from sgslam.backend import Backend, FactorLog
from sgslam.backend.factor_log import Entry, Kind
from sgslam.mapping import Anchors

SPOILT = 40  # a keyframe amid the run


def spoilt_run(odometry: float = 0.0, guess: float = 0.0) -> Run:
    """A run in which one keyframe has a number added to its odometry, or to where the tracking took it to be."""
    run = Run()
    backend, run.backend = run.backend, Backend(CONFIG)
    for i, keyframe in enumerate(backend.keyframes):
        if i == SPOILT:
            T_odom, T_map = keyframe.T_track_sensor.copy(), keyframe.T_map_sensor.copy()
            T_odom[0, 3] += odometry
            T_map[0, 3] += guess
            keyframe = replace(keyframe, T_track_sensor=T_odom, T_map_sensor=T_map)
        run.backend.add_keyframe(keyframe)
    return run


def anchored(run: Run) -> tuple[Anchors, Array]:
    return anchors_of(run, pose(3.0, -8.0, 12.5, 2.5))


def off(run: Run, T_map_local: Array) -> float:
    """m, of the BIM frame."""
    assert run.backend.T_map_local is not None
    return float(np.linalg.norm((run.backend.T_map_local - T_map_local)[:3, 3]))


def barred(log: FactorLog) -> set[tuple[Kind, object]]:
    return {(e.kind, e.key[0]) for e in log.events if e.what == "barred"}


@pytest.mark.parametrize(
    ("odometry", "guess"),
    [(np.nan, 0.0), (np.inf, 0.0), (1e12, 0.0), (1e155, 0.0), (0.0, np.nan), (0.0, -np.inf), (0.0, 1e12), (0.0, 1e200)],
)
@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
def test_numbers_that_no_optimizer_can_use_are_barred_and_bridged(
    odometry: float, guess: float, caplog: pytest.LogCaptureFixture
) -> None:
    """An absurd start is taken from the odometry instead."""
    run = spoilt_run(odometry, guess)
    run.optimise()
    assert "failed" in caplog.text and "rebuilt from the log" in caplog.text
    assert np.isfinite(run.backend.poses).all() and run.errors().max() < 0.03
    steps = {("odometry", SPOILT), ("odometry", SPOILT + 1)} if odometry else set()
    assert barred(run.backend.log) == steps
    caplog.clear()
    run.optimise()  # what was barred stays out
    assert not caplog.text and run.errors().max() < 0.03
    assert run.backend.uncertainty() is not None


def test_a_factor_that_gtsam_refuses_is_barred_and_all_else_holds(caplog: pytest.LogCaptureFixture) -> None:
    """It is about a keyframe that does not exist, at which the optimizer throws; and later comes another one."""
    run = Run()
    for number in range(2):
        lost = gtsam.BetweenFactorPose3(X(3), X(999), gtsam.Pose3(), factors.noise_of_pose(0.1, 0.1))
        run.backend.log.add(60, "start", ("lost", number), Entry(lost, "somebody", "to spoil it"))
        run.optimise()
        assert caplog.text.count("rebuilt from the log") == number + 1 and run.errors().max() < 0.02
    assert barred(run.backend.log) == {("start", "lost")}
    assert "by somebody, is barred: GTSAM refuses it" in caplog.text


def test_anchors_that_break_the_optimizer_are_withdrawn_and_can_come_back(caplog: pytest.LogCaptureFixture) -> None:
    run = Run()
    anchors, T_map_local = anchored(run)
    run.optimise(replace(anchors, T_map_local=np.where(np.eye(4) > 0, np.nan, anchors.T_map_local)))
    assert "failed" in caplog.text and run.backend.T_map_local is None
    assert run.errors().max() < 0.02 and not run.backend.log.held("anchor")
    run.optimise(anchors)
    assert off(run, T_map_local) < 0.02


@pytest.mark.parametrize("number", [0, 7])  # the first of a wall, and one of those after it
def test_refused_numbers_are_logged_once_and_left_out(number: int, caplog: pytest.LogCaptureFixture) -> None:
    run = Run()
    run.seen[number].plane = np.full(4, np.nan)
    anchors, T_map_local = anchored(run)
    spoilt = {**anchors.planes, 4: [replace(anchors.planes[4][0], plane=np.zeros(4))]}
    for _ in range(2):
        run.optimise(replace(anchors, planes=spoilt))
    assert caplog.text.count("is refused: a plane must be four finite numbers") == 2 and "failed" not in caplog.text
    assert off(run, T_map_local) < 0.02 and run.errors().max() < 0.02


def test_what_is_beyond_repair_leaves_the_last_optimum(caplog: pytest.LogCaptureFixture) -> None:
    run = Run()
    run.optimise()
    before = run.backend.poses
    for s in run.seen:  # half of those who saw a wall say that it stands beyond the moon
        s.plane = s.plane + np.array([0, 0, 0, 1e12 * (s.keyframe % 2)])
    run.backend.log.withdraw(60, "wall", list(run.backend.log.held("wall")), "seen again")
    run.optimise()
    assert "the last estimates are kept" in caplog.text
    np.testing.assert_array_equal(run.backend.poses, before)


def test_the_log_has_the_origin_and_the_events_of_an_anchor() -> None:
    run = Run()
    anchors, _ = anchored(run)
    paired = replace(anchors.planes[1][0], a_id="A1", by="match 3", why="as planned")
    for planned in (paired, None, replace(paired, by="position", why="120 mm off")):
        run.optimise(None if planned is None else replace(anchors, planes={**anchors.planes, 1: [planned]}))
    events = [(e.key[0], e.what, e.by) for e in run.backend.log.events if e.kind == "anchor" and e.key[1:] == (1, "A1")]
    assert events == [("wall", "added", "match 3"), ("wall", "withdrawn", "match 3"), ("wall", "added", "position")]
