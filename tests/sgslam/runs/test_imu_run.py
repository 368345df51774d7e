"""An IMU given to a run: by library, and in a bag with the scans."""

import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from bag_files import START, cloud, imu, store, write_bag
from boxes import pose, room, scan, scene_of
from commands import called, refused

from data.common.errors import UserError
from data.imu import ImuSamples, write_imu
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
    assert slam.newest_imu_ns == 6


def test_a_restored_run_has_the_samples() -> None:
    slam, other = SceneGraphSlam(), SceneGraphSlam()
    stamps = np.arange(0, 10**8, 5_000_000)
    slam.add_imu(stamps, np.zeros((len(stamps), 3)), np.tile(UP, (len(stamps), 1)))
    slam.add_scan(0, scan(scene_of(room(-3.0, -2.0, 5.0, 3.0)), pose(0.0, 0.0, 1.3)))
    other.restore(slam.state())
    assert other.newest_imu_ns == stamps[-1]


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
    assert "no such IMU" in refused("sgslam.run", "--scan-dir", bag, "--imu", bag, "--imu-topic", "/points")


def write_standing(folder: Path) -> Path:
    """Half a second of scans of a standing sensor, and `imu.csv`."""
    scene = scene_of(room(-3.0, -2.0, 5.0, 3.0))
    folder.mkdir()
    for k in range(6):
        np.save(folder / f"{k}.npy", scan(scene, pose(0.0, 0.0, 1.3), seed=k))
    stamps = np.arange(0, 8 * 10**8, 5_000_000)
    write_imu(ImuSamples(stamps, np.zeros((len(stamps), 3)), np.tile(UP, (len(stamps), 1))), folder / "imu.csv")
    return folder


def test_a_lidar_inertial_odometry_without_its_library_or_an_imu_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scans = write_standing(tmp_path / "scans")
    for method in ("rko_lio", "genz_lio"):
        told = ("sgslam.run", "--single-pass", "--scan-dir", scans, "--odometry", method, "--out", tmp_path / "out")
        if find_spec(method) is not None:
            assert f"--odometry {method}: needs an IMU; give its samples with --imu FILE" in refused(*told)
        monkeypatch.setitem(sys.modules, method, None)  # as if it were not installed
        said = refused(*told, "--imu", scans / "imu.csv")
        assert f"odometry {method}: the library is not installed; pip install 'sgslam[{method}]'" in said


@pytest.mark.long
@pytest.mark.parametrize("method", ["rko_lio", "genz_lio"])
def test_what_a_library_prints_is_not_on_standard_output(method: str, tmp_path: Path) -> None:
    if find_spec(method) is None:
        pytest.skip(f"needs the extra {method}")
    scans = write_standing(tmp_path / "scans")
    words = ["--scan-dir", scans, "--imu", scans / "imu.csv", "--odometry", method, "--out", tmp_path / "out"]
    command = [sys.executable, "-m", "sgslam.run", "--single-pass", *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    assert "IMU" not in done.stdout and "Profiling" not in done.stdout
    moved = Trajectory.read_tum(tmp_path / "out/trajectory.tum").positions
    assert len(moved) == 6 and np.linalg.norm(moved - moved[0], axis=1).max() < 0.05
