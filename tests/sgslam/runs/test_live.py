"""Live use: answers at once, and at the end the result of a run on the same scans."""

import json
import logging
import os
import signal
import subprocess
import sys
from pathlib import Path
from time import sleep
from typing import Any

import numpy as np
import pytest
from boxes import pose
from commands import refused
from drives import fed, small_drive

from data.common.errors import UserError
from data.plans.bim import load_bim
from data.trajectory import Trajectory
from sgslam.cli.processes.run_map import map_start
from sgslam.cli.processes.tracking_side import LogLines
from sgslam.live.live_slam import LiveSlam, latencies
from sgslam.slam import SceneGraphSlam

PART = 150  # scans of the small drive, after which it is anchored
FILES = ("trajectory.tum", "trajectory_map.tum", "trajectory_odometry.tum", "s_graph.json", "deviations.json")


@pytest.fixture(scope="module")
def building(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("building") / "a_graph.json"
    small_drive().bim.graph.save(path)
    return path


@pytest.mark.slow
def test_a_live_run_ends_with_the_files_of_a_run_and_its_odometry_never_jumps(building: Path, tmp_path: Path) -> None:
    """At most five scans may wait, so that here, where they come as fast as they are tracked, tracking waits."""
    drive = small_drive()
    fed(SceneGraphSlam(load_bim(building)), drive.scans[:PART]).finish().save(tmp_path / "offline")
    answers = []
    with LiveSlam(tmp_path / "live", building, most_waiting=5) as live:
        for stamp_ns, points in drive.scans[:PART]:
            answers.append(live.add_scan(stamp_ns, points, np.zeros(len(points))))
        metrics = live.finish()
    for name in FILES:
        assert (tmp_path / "live" / name).read_bytes() == (tmp_path / "offline" / name).read_bytes(), name
    assert metrics["anchored"] and metrics["live"]["answers"] == metrics["scans"] == PART
    assert max(answer.waiting for answer in answers[60:]) <= 5
    odometry = Trajectory.read_tum(tmp_path / "live" / "trajectory_odometry.tum").poses
    settled = [k for k, answer in enumerate(answers) if answer.health is not None]
    assert 0 < settled[0] < 60 and settled == list(range(settled[0], PART))
    told = np.stack([answers[k].T_odom_sensor for k in settled])
    np.testing.assert_allclose(told, odometry[settled], atol=1e-9)
    newest = answers[-1]
    assert newest.T_bim_sensor is not None and newest.anchors and newest.map_stamp_ns is not None
    assert np.linalg.norm(newest.T_bim_sensor[:3, 3] - drive.truth.at(np.array([newest.stamp_ns]))[0, :3, 3]) < 0.1
    assert answers[0].T_bim_sensor is None and not answers[0].anchors


@pytest.mark.slow
def test_the_command_answers_in_lines_and_ctrl_c_ends_it_with_the_results(building: Path, tmp_path: Path) -> None:
    (tmp_path / "scans").mkdir()
    for stamp_ns, points in small_drive().scans[:30]:
        np.save(tmp_path / "scans" / f"{stamp_ns + 10**18}.npy", points)
    given = [str(tmp_path / "scans"), "--bim", str(building), "--out", str(tmp_path / "out")]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = subprocess.Popen([sys.executable, "-m", "sgslam", "live", *given], text=True, **pipes)
    assert process.stdout is not None
    lines: list[dict[str, Any]] = [json.loads(process.stdout.readline())]
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
    assert "Traceback" not in said
    assert len(Trajectory.read_tum(tmp_path / "out" / "trajectory.tum")) == 31
    assert json.loads((tmp_path / "out" / "metrics.json").read_text())["live"]["answers"] == 31


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
    assert not any(isinstance(handler, LogLines) for handler in logging.getLogger("sgslam").handlers)


def test_a_pose_told_now_is_one_of_the_maps_origin() -> None:
    sensor = pose(2.0, -1.0, 1.0, yaw=0.7)
    x, y, yaw = map_start((10.0, 20.0, 0.3), sensor)
    np.testing.assert_allclose(pose(x, y, 0.0, yaw=yaw) @ sensor, pose(10.0, 20.0, 1.0, yaw=0.3), atol=1e-12)


def test_latencies_are_those_within_which_so_many_answers_came() -> None:
    assert latencies([])["p50_ms"] is None
    told = latencies([milliseconds / 1000 for milliseconds in (*range(1, 100), 2000)])
    assert (told["answers"], told["p50_ms"], told["p99_ms"], told["longest_ms"]) == (100, 50, 99, 2000)
