"""All that goes wrong in the field is reported and survived; while the robot stands, its map does not grow."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bag_files import NS, cloud, store, write_bag
from boxes import pose, room, scan, scene_of
from commands import called

from data.simulation import Sensor
from data.trajectory import Trajectory
from sgslam.config import KeyframeSettings
from sgslam.mapping import KeyframeRule

NOTHING = np.full((100, 3), np.nan, np.float32)


def disturbed(types: Any) -> list[tuple[int, Any]]:
    """120 scans at 10 Hz: 60 standing still, 60 moving; one of NaN, five times one stamp, one stamp of the far future,
    and an hour's pause before the last twenty."""
    scene, sensor, messages = scene_of(room(-3, -2, 3, 2)), Sensor(azimuths=360), []
    for k in range(120):
        stamp = 1_000 * NS + k * NS // 10 + (3600 * NS if k >= 100 else 0)
        points = scan(scene, pose(0.02 * max(0, k - 60), 0.0, 1.0), sensor, k).astype(np.float32)
        told = 1_000 * NS + 79 * NS // 10 if 80 <= k < 85 else stamp + 3_600_000 * NS if k == 90 else stamp
        messages.append((stamp, cloud(types, NOTHING if k == 70 else points, told, padding=0)))
    return messages


@pytest.mark.long
@pytest.mark.parametrize("cut", [False, True])
def test_all_disturbances_are_reported_and_survived(cut: bool, tmp_path: Path) -> None:
    bag = write_bag(tmp_path / "drive.bag", "ros1", {"/points": disturbed(store(True))})
    if cut:
        whole = bag.read_bytes()
        bag.write_bytes(whole[: int(0.97 * len(whole))])
    done = called("sgslam.run", "--single-pass", "--scan-dir", bag, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    metrics = json.loads((tmp_path / "out" / "metrics.json").read_text())
    log = (tmp_path / "out" / "run.log").read_text()
    trajectory = Trajectory.read_tum(tmp_path / "out" / "trajectory.tum")
    assert metrics["scans_skipped"] == 7 and metrics["scans"] == len(trajectory) == sum(metrics["tracked"].values())
    assert len(trajectory) == 113 if not cut else 100 < len(trajectory) < 113
    lines = ("scan 70: skipped, all of its", "scan 80: skipped", "scan 90: skipped", "before scan 100")
    assert [line for line in lines if line not in log] == []
    assert ("what could be read is used" in log) == cut
    assert np.abs(trajectory.positions[:60]).max() < 0.02
    parts = [line.split(",")[7] for line in (tmp_path / "out" / "trajectory_sigma.csv").read_text().splitlines()]
    before = parts[1:].count("0")
    assert abs(trajectory.positions[before - 1, 0] - 0.02 * 39) < 0.05  # where it was before the pause
    assert set(parts[before + 1 :]) == {"1"}  # after an hour it may be anywhere


def test_a_bag_of_nothing_but_bad_scans_is_refused(tmp_path: Path) -> None:
    messages = [(k * NS, cloud(store(), NOTHING, k * NS)) for k in range(1, 9)]
    bag = write_bag(tmp_path / "nan", "mcap", {"/p": messages})
    done = called("sgslam.run", "--single-pass", "--scan-dir", bag, "--out", tmp_path / "out")
    assert done.returncode == 2 and "more than a fifth" in done.stderr.splitlines()[-1]


def test_keyframes_of_an_hours_standing_are_few() -> None:
    """After a walk, and before the walk back."""
    way = np.tile(np.eye(4), (100, 1, 1))
    way[:, 0, 3] = np.arange(100) * 0.08
    hour = np.repeat(way[-1:], 36_000, axis=0)
    hour[:, :2, 3] += np.random.default_rng(0).normal(0.0, 0.003, (len(hour), 2))
    rule = KeyframeRule(KeyframeSettings())
    taken = np.array([rule.offer(place) for place in np.concatenate([way, hour, way[::-1]])])
    assert taken[100:-100].sum() < 12
    # as soon as it moves on they come as they did before
    assert taken[-99:].sum() == pytest.approx(taken[1:100].sum(), abs=1)
