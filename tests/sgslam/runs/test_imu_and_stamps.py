"""An IMU that is given to a run, and stamps that name another instant of a scan than its start."""

from pathlib import Path

import numpy as np
import pytest
from bag_files import START, cloud, imu, lidar_bag, scan_points, store, write_bag
from boxes import pose, room, scan, scene_of
from commands import called, refused

from data.common.errors import UserError
from data.scans import Scan, ScanSource
from data.scans.sources import open_scans
from data.scans.writers import SCAN_WRITERS
from data.streams import Arrival, GrowingFolder
from data.trajectory import Trajectory
from sgslam import SceneGraphSlam

UP = np.array([0.0, 0.0, 9.8])
STILL = np.zeros(3)


def test_samples_that_go_back_or_are_not_finite_are_refused() -> None:
    slam = SceneGraphSlam()
    slam.add_imu(5, STILL, UP)
    for stamp, gyro, accel in ((5, STILL, UP), (6, STILL * np.nan, UP), (6, np.zeros(2), UP)):
        with pytest.raises(UserError, match="IMU"):
            slam.add_imu(stamp, gyro, accel)
    slam.add_imu(6, STILL, UP)


@pytest.mark.slow
def test_a_bags_imu_tells_that_the_sensor_hangs_upside_down(tmp_path: Path) -> None:
    types, scene, hangs = store(ros1=True), scene_of(room(-3.0, -2.0, 5.0, 3.0)), np.diag([1.0, -1.0, -1.0, 1.0])
    stamps = [START + k * 10**8 for k in range(25)]
    taken = [scan(scene, pose(0.03 * k, 0.0, 1.3) @ hangs, seed=k).astype(np.float32) for k in range(25)]
    samples = [(s, imu(types, s, STILL, -UP)) for s in range(START, stamps[-1] + 2 * 10**8, 10**7)]
    clouds = [(s, cloud(types, points, s)) for s, points in zip(stamps, taken, strict=True)]
    bag = write_bag(tmp_path / "a.bag", "ros1", {"/points": clouds, "/imu": samples})
    done = called("sgslam.run", "--single-pass", "--scan-dir", bag, "--imu", bag, "--out", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    up = Trajectory.read_tum(tmp_path / "out/trajectory.tum").poses[-1, 2, :3]  # in the sensor's axes
    assert up == pytest.approx([0.0, 0.0, -1.0], abs=0.02)
    words = ("sgslam.run", "--scan-dir", bag, "--imu", bag)
    assert "no such topic with IMU samples" in refused(*words, "--imu-topic", "/points")


TIMES = np.linspace(0.0, 0.099, 40, dtype=np.float32)  # s, from the first point


@pytest.mark.parametrize("form", ["folder", "growing folder", "bag"])
def test_every_reader_counts_relative_times_from_the_instant_that_is_stamped(form: str, tmp_path: Path) -> None:
    made = tmp_path if "folder" in form else lidar_bag(tmp_path / "bag", "mcap", 2)
    if "folder" in form:
        for k in range(2):
            SCAN_WRITERS["ply"](tmp_path / f"{k}.5.ply", scan_points(k), TIMES)
    source: ScanSource | GrowingFolder
    if form == "growing folder":
        source = GrowingFolder(made)
        source.stamped = "end"
    else:
        source = open_scans(made, stamped="end")
    first = next(iter(source))
    read = first.scan if isinstance(first, Arrival) else first
    assert isinstance(read, Scan) and read.point_times == pytest.approx(TIMES - 0.099, abs=1e-6)


@pytest.mark.slow
def test_a_run_says_which_instant_it_takes_stamps_for(tmp_path: Path) -> None:
    scene = scene_of(room(-3.0, -2.0, 5.0, 3.0))
    (tmp_path / "scans").mkdir()
    for k in range(6):
        np.save(tmp_path / f"scans/{k}.npy", scan(scene, pose(0.02 * k, 0.0, 1.3), seed=k))
    for more, stamped in ((("--stamp", "end"), "end"), ((), "start")):
        out = tmp_path / stamped
        done = called("sgslam.run", "--single-pass", "--scan-dir", tmp_path / "scans", "--out", out, *more)
        assert done.returncode == 0, done.stderr
        assert f"stamp: {stamped}" in (out / "config.yaml").read_text()
        assert f"{stamped} of a scan" in (out / "report.html").read_text()
