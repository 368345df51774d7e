"""The simulated IMU: what it measures of a known motion, and how it errs."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from small_ifc import write_small_ifc

from data.imu import read_imu
from data.simulation import SpinningSensor
from data.simulation.carriers import HANDHELD
from data.simulation.imu import RATE, ImuModel, measured
from data.simulation.simulate import simulate
from data.trajectory import Trajectory

IDEAL = ImuModel()
Array = NDArray[np.float64]


def still(R: Array) -> Array:
    T = np.eye(4)
    T[:3, :3] = R
    return T


def swinging(seconds: Array) -> Array:
    """Poses of a sensor that turns about all axes, up to 3 rad/s, on a circle of 2 m at 1 rad/s."""
    T = np.tile(np.eye(4), (len(seconds), 1, 1))
    angles = np.column_stack([2.0 * seconds, 0.5 * np.sin(3 * seconds), 0.4 * np.cos(4 * seconds)])
    T[:, :3, :3] = Rotation.from_euler("ZYX", angles).as_matrix()
    T[:, :3, 3] = np.column_stack([2 * np.cos(seconds), 2 * np.sin(seconds), np.full(len(seconds), 1.0)])
    return T


def test_integrating_an_ideal_gyroscope_gives_back_the_rotations() -> None:
    samples = measured(swinging, 5.0, IDEAL, 0)
    turns = Rotation.from_rotvec(samples.gyro / RATE)  # each over the time around its sample
    R = Rotation.from_matrix(swinging(np.array([-0.5 / RATE]))[0, :3, :3])
    for turn in turns:
        R = R * turn
    truth = Rotation.from_matrix(swinging(np.array([5.0 + 0.5 / RATE]))[0, :3, :3])
    assert (R.inv() * truth).magnitude() < 1e-9


def test_a_still_sensor_measures_gravity_upwards() -> None:
    R = Rotation.from_euler("ZYX", [0.3, -0.8, 2.5]).as_matrix()
    samples = measured(lambda seconds: np.tile(still(R), (len(seconds), 1, 1)), 0.1, IDEAL, 0)
    assert samples.gyro == pytest.approx(0.0, abs=1e-12)
    assert samples.accel @ R.T == pytest.approx(np.tile([0.0, 0.0, 9.80665], (21, 1)), abs=1e-9)


def test_a_drive_writes_samples_until_its_end_and_the_truth_agrees_with_them(tmp_path: Path) -> None:
    building = write_small_ifc(tmp_path / "small.ifc")
    sensor = SpinningSensor(azimuths=40)
    way = {"carrier": HANDHELD, "seconds": 3.0, "mount_deg": (180.0, 0.0, 0.0)}
    run = simulate(building.path, "Ground", tmp_path / "run", 1, sensor=sensor, imu="tactical", **way)
    samples = read_imu(run.out_dir / "scans" / "imu.csv")
    assert samples.stamps_ns[[0, -1]].tolist() == [0, 3_000_000_000]
    assert np.median(samples.accel[:, 2]) < -9.0  # it hangs
    truth = Trajectory.read_tum(run.out_dir / "truth.tum")
    R = Rotation.from_matrix(truth.poses[0, :3, :3])
    for rate in samples.gyro[: int(truth.stamps_ns[-1] / 1e9 * RATE)]:
        R = R * Rotation.from_rotvec(rate / RATE)
    assert (R.inv() * Rotation.from_matrix(truth.poses[-1, :3, :3])).magnitude() < 0.01
