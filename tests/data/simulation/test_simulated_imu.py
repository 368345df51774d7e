"""The simulated IMU: what it measures of a known motion, and how it errs."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation
from small_ifc import write_small_ifc

from data.imu import read_imu
from data.simulation import SpinningSensor
from data.simulation.carriers import HANDHELD
from data.simulation.imu import RATE
from data.simulation.simulate import simulate
from data.trajectory import Trajectory


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
