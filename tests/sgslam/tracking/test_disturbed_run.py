"""A run on a bag with all that goes wrong in the field, by the command: it is reported and survived."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bag_files import NS, cloud, store, write_bag
from commands import called
from numpy.typing import NDArray

from data.trajectory import Trajectory

HOUR = 3600 * NS


def box_scan(x: float) -> NDArray[np.float32]:
    """A 6 x 4 x 2.6 m room with a pillar, seen from 1 m height at (x, 0)."""
    azimuth, elevation = np.meshgrid(1e-3 + np.radians(np.arange(-180, 180)), np.radians(np.arange(-15, 16, 2)))
    d = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], -1)
    d = d.reshape(-1, 3)
    sides = ((d[:, 0], x, -3.0, 3.0), (d[:, 1], 0.0, -2.0, 2.0), (d[:, 2], 0.0, -1.0, 1.6))
    hits = np.stack([np.where(c > 0, (high - at) / c, (low - at) / c) for c, at, low, high in sides])
    return (d * hits.min(axis=0)[:, None]).astype(np.float32)


def disturbed(types: Any) -> list[tuple[int, Any]]:
    """120 scans at 10 Hz: 60 standing still, 60 moving; one of NaN, five times one stamp, one stamp of the far future,
    and an hour's pause before the last twenty."""
    messages = []
    for k in range(120):
        stamp = 1_000 * NS + k * NS // 10 + (HOUR if k >= 100 else 0)
        points = box_scan(0.02 * max(0, k - 60))
        if k == 70:
            points = np.full((100, 3), np.nan, np.float32)
        told = 1_000 * NS + 79 * NS // 10 if 80 <= k < 85 else stamp + 1000 * HOUR if k == 90 else stamp
        messages.append((stamp, cloud(types, points, told, padding=0)))
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
    assert metrics["scans_skipped"] == 7 and metrics["scans"] == len(trajectory)
    assert sum(metrics["tracked"].values()) == metrics["scans"]
    assert len(trajectory) == 113 if not cut else 100 < len(trajectory) < 113
    for told in ("scan 70: skipped, all of its returns are NaN", "scan 80: skipped, its stamp repeats",
                 "scan 90: skipped, its stamp", "before scan 100"):  # fmt: skip
        assert told in log, log
    assert ("what could be read is used" in log) == cut
    standing = trajectory.positions[:60]
    assert np.abs(standing).max() < 0.02
    parts = [line.split(",")[7] for line in (tmp_path / "out" / "trajectory_sigma.csv").read_text().splitlines()]
    before = parts[1:].count("0")
    assert abs(trajectory.positions[before - 1, 0] - 0.02 * 39) < 0.05  # where it was before the pause
    assert set(parts[before + 1 :]) == {"1"}  # after an hour it may be anywhere


def test_a_bag_of_nothing_but_bad_scans_is_refused(tmp_path: Path) -> None:
    types = store()
    messages = [(k * NS, cloud(types, np.full((9, 3), np.nan, np.float32), k * NS)) for k in range(1, 9)]
    bag = write_bag(tmp_path / "nan", "mcap", {"/p": messages})
    done = called("sgslam.run", "--single-pass", "--scan-dir", bag, "--out", tmp_path / "out")
    assert done.returncode == 2 and "more than a fifth" in done.stderr.splitlines()[-1]
