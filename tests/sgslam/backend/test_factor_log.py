"""The factor log: origin and reason of each factor; and the graph rebuilt from it after optimizer failures."""

from dataclasses import replace

import gtsam
import numpy as np
import pytest
from boxes import Array, pose
from drives import fed, small_drive
from gtsam.symbol_shorthand import X
from two_rooms import CONFIG, Run, anchors_of

import factors
from sgslam.backend import Backend, FactorLog
from sgslam.backend.backend import PlannedWall, RoomNode
from sgslam.backend.factor_log import Entry, Kind
from sgslam.geometry.frames import inverse, transform_planes
from sgslam.slam import SceneGraphSlam

T_BIM_BUILDING = pose(3.0, -8.0, 12.5, 2.5)
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


def last_events(log: FactorLog, what: str) -> set[tuple[Kind, object]]:
    return {(e.kind, e.key[0]) for e in log.events if e.what == what}


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e12, 1e155])
@pytest.mark.filterwarnings("ignore:invalid value:RuntimeWarning")
def test_steps_that_no_optimizer_can_use_are_barred_and_bridged(bad: float, caplog: pytest.LogCaptureFixture) -> None:
    run = spoilt_run(odometry=bad)
    run.optimise()
    assert "failed" in caplog.text and "rebuilt from the log" in caplog.text
    assert np.isfinite(run.backend.poses).all() and run.errors().max() < 0.03
    assert last_events(run.backend.log, "barred") == {("odometry", SPOILT), ("odometry", SPOILT + 1)}
    caplog.clear()
    run.optimise()  # what was barred stays out
    assert not caplog.text and run.errors().max() < 0.03
    assert run.backend.uncertainty() is not None


@pytest.mark.parametrize("bad", [np.nan, -np.inf, 1e12, 1e200])
def test_an_absurd_start_is_taken_from_the_odometry_instead(bad: float, caplog: pytest.LogCaptureFixture) -> None:
    run = spoilt_run(guess=bad)
    run.optimise()
    assert "rebuilt from the log" in caplog.text and not last_events(run.backend.log, "barred")
    assert run.errors().max() < 0.02


def test_a_factor_that_gtsam_refuses_is_barred_and_all_else_holds(caplog: pytest.LogCaptureFixture) -> None:
    """It is about a keyframe that does not exist, at which the optimizer throws."""
    run = Run()
    stray = gtsam.BetweenFactorPose3(X(3), X(999), gtsam.Pose3(), factors.noise_of_pose(0.1, 0.1))
    run.backend.log.add(60, "start", ("stray",), Entry(stray, "somebody", "to spoil it"))
    run.optimise()
    assert "failed" in caplog.text and run.errors().max() < 0.02
    assert last_events(run.backend.log, "barred") == {("start", "stray")}
    assert "by somebody, is barred: GTSAM refuses it" in caplog.text


def test_anchors_that_break_the_optimizer_are_withdrawn_and_can_come_back(caplog: pytest.LogCaptureFixture) -> None:
    run = Run()
    anchors, T_map_bim = anchors_of(run, T_BIM_BUILDING)
    nowhere = replace(anchors, T_map_bim=np.where(np.eye(4) > 0, np.nan, anchors.T_map_bim))
    run.optimise(nowhere)
    assert "failed" in caplog.text and run.backend.T_map_bim is None
    assert run.errors().max() < 0.02 and not run.backend.log.held("anchor")
    run.optimise(anchors)
    assert run.backend.T_map_bim is not None and np.linalg.norm((run.backend.T_map_bim - T_map_bim)[:3, 3]) < 0.02


def test_one_bad_anchor_leaves_the_others() -> None:
    run = Run()
    anchors, T_map_bim = anchors_of(run, T_BIM_BUILDING)
    planned = anchors.planes[2][0]
    spoilt = {**anchors.planes, 2: [replace(planned, place=np.array([1e200, 0, 0]))]}
    run.optimise(replace(anchors, planes=spoilt))
    assert run.backend.T_map_bim is not None and np.linalg.norm((run.backend.T_map_bim - T_map_bim)[:3, 3]) < 0.03
    held = {key[1] for key in run.backend.log.held("anchor") if key[0] == "wall" and len(key) == 3}
    assert held == {0, 1, 3, 4, 5}


@pytest.mark.parametrize("number", [0, 7])  # the first of a wall, and one of those after it
def test_refused_numbers_are_logged_once_and_left_out(
    number: int, caplog: pytest.LogCaptureFixture
) -> None:
    run = Run()
    run.seen[number].plane = np.full(4, np.nan)
    anchors, T_map_bim = anchors_of(run, T_BIM_BUILDING)
    spoilt = {**anchors.planes, 4: [replace(anchors.planes[4][0], plane=np.zeros(4))]}
    for _ in range(2):
        run.optimise(replace(anchors, planes=spoilt))
    assert caplog.text.count("is refused: a plane must be four finite numbers") == 2 and "failed" not in caplog.text
    assert run.backend.T_map_bim is not None and np.linalg.norm((run.backend.T_map_bim - T_map_bim)[:3, 3]) < 0.02
    assert run.errors().max() < 0.02


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


def test_a_rebuilt_graph_ends_where_one_that_never_failed_does() -> None:
    ends = []
    for guess in (0.0, np.nan):
        run = spoilt_run(guess=guess)
        anchors, _ = anchors_of(run, T_BIM_BUILDING)
        run.optimise(anchors, steps=50)
        run.optimise(anchors, steps=50)
        ends.append(run.backend.poses)
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-3)


def test_the_same_log_gives_the_same_graph() -> None:
    run = Run()
    anchors, _ = anchors_of(run, T_BIM_BUILDING)
    run.optimise(anchors)
    first, second = run.backend.log.graph(), run.backend.log.graph()
    assert first.size() == second.size() == sum(c["held"] for c in run.backend.log.counts().values())
    assert first.equals(second, 1e-12)


def test_factors_are_added_once_and_only_what_is_new() -> None:
    run = Run()
    run.optimise()
    log = run.backend.log
    added, held = len(log.events), {kind: dict(log.held(kind)) for kind in ("wall", "level", "odometry")}
    run.optimise()
    assert len(log.events) == added
    for kind, entries in held.items():
        assert all(log.held(kind)[key] is entry for key, entry in entries.items())
    assert all(e.by and e.why for e in log.events)


def test_the_log_has_the_origin_and_the_events_of_an_anchor() -> None:
    run = Run()
    anchors, _ = anchors_of(run, T_BIM_BUILDING)
    paired = PlannedWall(anchors.planes[1][0].plane, anchors.planes[1][0].place, "A1", "match 3", "as planned")
    run.optimise(replace(anchors, planes={**anchors.planes, 1: [paired]}))
    run.optimise()
    run.optimise(replace(anchors, planes={**anchors.planes, 1: [replace(paired, by="position", why="120 mm off")]}))
    told = [(e.key[0], e.what, e.by) for e in run.backend.log.events if e.kind == "anchor" and e.key[1:] == (1, "A1")]
    assert told == [
        ("wall", "added", "match 3"),
        ("wall", "withdrawn", "match 3"),
        ("wall", "added", "position"),
    ]


def test_rooms_are_logged_when_they_are_segmented_again() -> None:
    run = Run()
    run.optimise()
    T_map_room: Array = inverse(run.T_building_map) @ pose(3.0, 4.0, 0.0)
    room = RoomNode(
        7, T_map_room, {w: transform_planes(inverse(T_map_room), run.backend.planes_in_map[w]) for w in range(4)}
    )
    run.optimise(rooms=[room])
    run.optimise(rooms=[replace(room, id=8, walls={0: room.walls[0]})])
    counts = run.backend.log.counts()["room"]
    assert counts == {"held": 2, "added": 7, "withdrawn": 5, "barred": 0, "refused": 0}


def test_a_run_outlives_failures_of_the_optimizer(caplog: pytest.LogCaptureFixture) -> None:
    """Twice a factor comes in at which GTSAM throws; and the run ends where it would have ended."""
    drive = small_drive()
    slam = SceneGraphSlam(drive.bim)
    for k, (stamp_ns, points) in enumerate(drive.scans):
        slam.add_scan(stamp_ns, points)
        if k in (60, 180):
            stray = gtsam.BetweenFactorPose3(X(3), X(999), gtsam.Pose3(), factors.noise_of_pose(0.1, 0.1))
            slam._map.backend.log.add(0, "start", ("stray", k), Entry(stray, "somebody", "to spoil it"))
    result = slam.finish()
    assert caplog.text.count("rebuilt from the log") == 2
    assert result.anchored and drive.rmse(result) < 0.02


def test_a_run_hands_its_log_over() -> None:
    drive = small_drive()
    result = fed(SceneGraphSlam(drive.bim), drive.scans[:150]).finish()
    assert result.anchored, result.reason
    counts = result.factors.counts()
    assert counts["odometry"]["held"] == result.keyframes - 1
    assert counts["anchor"]["held"] > 10 and counts["wall"]["held"] > 100
    tight = {(f"w{key[1]}", key[2]) for key in result.factors.held("anchor") if key[0] == "wall" and len(key) == 3}
    states = {(r["wall"], r["a_id"]): r["state"] for r in result.anchors}
    assert tight and all(states[key] == "tight" for key in tight)
    assert {e.by.split()[0] for e in result.factors.events} >= {"odometry", "wall", "level", "match", "start"}
