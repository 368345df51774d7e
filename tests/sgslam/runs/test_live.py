"""Live use: answers at once, and at the end the result of a run on the same scans."""

import json
import logging
import os
import pickle
import signal
import subprocess
import sys
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import numpy as np
import pytest
from boxes import pose
from carried_off import carried_off
from commands import refused
from drives import fed, small_drive

from data.common.errors import UserError
from data.trajectory import Trajectory
from sgslam.config import Config
from sgslam.live import LiveSlam
from sgslam.live.commands import read_pose
from sgslam.live.latencies import Latencies
from sgslam.live.live_map import map_start
from sgslam.live.messages import TrackedMessage
from sgslam.slam import SceneGraphSlam
from sgslam.tracking import CarriedElsewhere, RunTracker

PART = 150  # scans of the small drive, after which it is anchored
FILES = ("trajectory.tum", "trajectory_map.tum", "trajectory_odometry.tum", "s_graph.json", "deviations.json")


@pytest.mark.long
def test_steps_of_a_tracker_elsewhere_give_the_map_of_the_scans_themselves() -> None:
    """Also where the sensor is carried elsewhere; the steps are those that another process gets."""
    tracker, apart, whole = RunTracker(Config()), SceneGraphSlam(), SceneGraphSlam()
    begun_anew = 0
    scans = carried_off()
    for last, (stamp_ns, points) in enumerate(scans, 1 - len(scans)):
        times = np.zeros(len(points))
        whole.add_scan(stamp_ns, points, times)
        for step in [*tracker.track(stamp_ns, points, times), *(tracker.release() if last == 0 else ())]:
            begun_anew += isinstance(step, CarriedElsewhere)
            message = pickle.loads(pickle.dumps(TrackedMessage.of(step, tracker.advice)))
            apart.add_tracked(message.step, message.advice)
    result, other = apart.finish(), whole.finish()
    assert begun_anew == apart.kidnaps == whole.kidnaps == 1
    assert np.array_equal(result.trajectory_map.poses, other.trajectory_map.poses)
    assert result.uncertainty.health == other.uncertainty.health and result.advice == other.advice
    assert result.s_graph == other.s_graph and result.factors.events == other.factors.events


@pytest.fixture(scope="module")
def building(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("building") / "a_graph.json"
    small_drive().bim.graph.save(path)
    return path


@pytest.mark.slow
def test_a_live_run_ends_with_the_files_of_a_run_and_its_odometry_never_jumps(building: Path, tmp_path: Path) -> None:
    """At most five scans may wait, so that here, where they come as fast as they are tracked, tracking waits."""
    drive = small_drive()
    fed(SceneGraphSlam(drive.bim), drive.scans[:PART]).finish().save(tmp_path / "offline")
    answers = []
    with LiveSlam(tmp_path / "live", building, most_waiting=5) as live:
        for stamp_ns, points in drive.scans[:PART]:
            answers.append(live.add_scan(stamp_ns, points, np.zeros(len(points))))
        metrics = live.finish()
    for name in FILES:
        assert (tmp_path / "live" / name).read_bytes() == (tmp_path / "offline" / name).read_bytes(), name
    assert metrics["anchored"] and metrics["live"]["answers"] == metrics["scans"] == PART
    assert max(answer.waiting for answer in answers[60:]) <= 5
    assert 0 < (tmp_path / "live" / "run.log").read_text().count("scans wait for the map") < 30
    odometry = Trajectory.read_tum(tmp_path / "live" / "trajectory_odometry.tum").poses
    settled = [k for k, answer in enumerate(answers) if answer.health is not None]
    assert 0 < settled[0] < 60 and settled == list(range(settled[0], PART))
    told = np.stack([answers[k].T_odom_sensor for k in settled])
    np.testing.assert_allclose(told, odometry[settled], atol=1e-9)
    newest = answers[-1]
    assert newest.T_bim_sensor is not None and newest.anchors and newest.map_stamp_ns is not None
    assert np.linalg.norm(newest.T_bim_sensor[:3, 3] - drive.truth.at(np.array([newest.stamp_ns]))[0, :3, 3]) < 0.1
    assert answers[0].T_bim_sensor is None and not answers[0].anchors


def written(folder: Path, count: int) -> None:
    """Files as a recorder leaves them."""
    for stamp_ns, points in small_drive().scans[:count]:
        hidden = folder / f".{stamp_ns + 10**18}.npy"
        np.save(hidden, points)
        hidden.rename(folder / hidden.name[1:])


def begun(*arguments: Path | str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "sgslam", "live", *map(str, arguments)], text=True, stdin=subprocess.PIPE,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip


@pytest.mark.long
def test_the_command_answers_in_lines_and_ctrl_c_ends_it_with_the_results(building: Path, tmp_path: Path) -> None:
    (tmp_path / "scans").mkdir()
    written(tmp_path / "scans", 30)
    process = begun(tmp_path / "scans", "--bim", building, "--out", tmp_path / "out")
    assert process.stdout is not None and process.stdin is not None
    lines: list[dict[str, Any]] = [json.loads(process.stdout.readline())]
    process.stdin.write("initialpose 1 2\ninitialpose 3001.5 -1998.5 0.5\n")
    process.stdin.flush()
    while len(lines) < 30:
        lines.append(json.loads(process.stdout.readline()))
    np.save(tmp_path / "scans" / f"{10**18 + 5_900_000_000}.npy", np.full((5, 3), np.nan))
    np.save(tmp_path / "scans" / f"{10**18 + 6_000_000_000}.npy", small_drive().scans[30][1])
    lines.append(json.loads(process.stdout.readline()))
    assert "NaN" in lines[-1]["skipped"][0]["reason"]
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=120)
    assert process.returncode == 0, said
    assert [line["scan"] for line in lines[:30]] == list(range(30))
    assert "not understood: 'initialpose 1 2'" in said and "Traceback" not in said
    assert len(Trajectory.read_tum(tmp_path / "out" / "trajectory.tum")) == 31
    assert "3001.50, -1998.50, 0.50" in (tmp_path / "out" / "run.log").read_text()
    assert json.loads((tmp_path / "out" / "metrics.json").read_text())["live"]["since_arrival"]["answers"] == 31


@pytest.mark.long
def test_where_the_process_that_tracks_is_killed_the_other_one_writes_what_it_has(tmp_path: Path) -> None:
    (tmp_path / "scans").mkdir()
    written(tmp_path / "scans", 60)
    process = begun(tmp_path / "scans", "--out", tmp_path / "out")
    assert process.stdout is not None
    lines = [json.loads(process.stdout.readline()) for _ in range(60)]
    assert lines[-1]["health"] == "good"
    process.kill()
    process.communicate()
    end = monotonic() + 60
    while not (tmp_path / "out" / "metrics.json").is_file() and monotonic() < end:
        sleep(0.1)
    assert 0 < len(Trajectory.read_tum(tmp_path / "out" / "trajectory.tum")) <= 60
    assert "the tracking process has ended" in (tmp_path / "out" / "run.log").read_text()


@pytest.mark.slow
def test_where_the_process_that_maps_is_ended_that_is_told(tmp_path: Path) -> None:
    live = LiveSlam(tmp_path / "out")
    os.kill(live._map._process.pid or 0, signal.SIGKILL)
    with pytest.raises(UserError, match="ended with exit code -9"):
        for stamp_ns, points in small_drive().scans:
            live.add_scan(stamp_ns, points, np.zeros(len(points)))
            sleep(0.01)
    with pytest.raises(UserError, match="ended with exit code -9"):
        live.finish()
    assert "was live" in refused("sgslam.run", "--resume", tmp_path / "out")
    assert not any(handler.__module__ == "sgslam.live.live_slam" for handler in logging.getLogger("sgslam").handlers)


@pytest.mark.long
def test_an_imu_tells_which_way_is_up(building: Path, tmp_path: Path) -> None:
    """Of a sensor that seems to hang upside down, as a bare room looks the same."""
    first, points = small_drive().scans[0]
    with LiveSlam(tmp_path / "out", building) as live:
        for k in range(60):
            stamps = first + k * 10**8 + np.arange(0, 10**8, 5_000_000)
            live.add_imu(stamps, np.zeros((20, 3)), np.tile([0.0, 0.0, -9.81], (20, 1)))
            answer = live.add_scan(first + k * 10**8, points, np.zeros(len(points)))
        assert answer.health == "good" and answer.T_odom_sensor[2, 2] < -0.99
        with pytest.raises(UserError, match="stamps must increase"):
            live.add_imu(stamps, np.zeros((20, 3)), np.tile([0.0, 0.0, -9.81], (20, 1)))


@pytest.mark.parametrize("sensor", [(0.0, 0.0, 0.0), (2.0, -1.0, 0.7)])
def test_a_pose_told_now_is_one_of_the_maps_origin(sensor: tuple[float, float, float]) -> None:
    x, y, yaw = map_start((10.0, 20.0, 0.3), pose(sensor[0], sensor[1], 1.0, yaw=sensor[2]))
    placed = pose(x, y, 0.0, yaw=yaw) @ pose(sensor[0], sensor[1], 1.0, yaw=sensor[2])
    np.testing.assert_allclose(placed, pose(10.0, 20.0, 1.0, yaw=0.3), atol=1e-12)


def test_a_line_is_a_pose_or_nothing() -> None:
    assert read_pose("initialpose 3.5 -1.2 1.57\n") == (3.5, -1.2, 1.57)
    for line in ("", "initialpose 1 2", "initialpose a b c", "initialpose 1 2 nan", "pose 1 2 3"):
        assert read_pose(line) is None


def test_latencies_are_those_within_which_so_many_answers_came() -> None:
    latencies = Latencies()
    assert latencies.percentile_ms(50) is None
    for milliseconds in [*range(1, 100), 2000]:
        latencies.add(milliseconds / 1000, waiting=milliseconds % 7)
    told = latencies.to_dict()
    assert (told["p50_ms"], told["p99_ms"], told["longest_ms"], told["most_waiting"]) == (50, 99, 2000, 6)
