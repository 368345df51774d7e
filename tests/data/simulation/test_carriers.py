"""Who carries the simulated sensor: how a person walks, what a recording gives, how a sensor is mounted."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from small_ifc import SmallBuilding

from data.common.errors import UserError
from data.imu import read_imu
from data.scans import ScanFolder
from data.simulation import Sensor
from data.simulation.carriers import HANDHELD, Recorded, carrier_named
from data.simulation.drive import plan_drive
from data.simulation.sensor import RATE as IMU_RATE
from data.simulation.sensor import SENSORS, imu_named, sensor_named
from data.simulation.simulate import simulate
from data.trajectory import Trajectory

RATE = 30.0  # poses a second, as in the recordings whose statistics are published
Array = NDArray[np.float64]


def written(path: Path, seconds: float = 40.0, speed: float = 1.0) -> Path:
    """A recording along a circle, 1.2 m high and looking 30 degrees to the left, that nods by 10 degrees in 4 s."""
    t = np.arange(0, seconds, 1 / 30)
    heading = speed * t / 8.0
    poses = np.tile(np.eye(4), (len(t), 1, 1))
    angles = np.column_stack([heading + np.radians(30), np.radians(10) * np.sin(2 * np.pi * t / 4), 0 * t])
    poses[:, :3, :3] = Rotation.from_euler("ZYX", angles).as_matrix()
    poses[:, :3, 3] = np.column_stack([8 * np.sin(heading), -8 * np.cos(heading), np.full(len(t), 1.2)])
    Trajectory(np.rint(t * 1e9).astype(np.int64), poses).write_tum(path)
    return path


@pytest.mark.parametrize(("pace", "reverse"), [(2.0, False), (1.0, True)])
def test_a_recording_gives_its_attitude_height_and_pace(tmp_path: Path, pace: float, reverse: bool) -> None:
    carrier = Recorded.read(written(tmp_path / "circle.tum"), pace, reverse)
    assert carrier.height == pytest.approx(1.2) and carrier.robot.speed == pytest.approx(pace, rel=0.05)
    leg = np.column_stack(
        [np.linspace(0, 90, 9001), np.zeros(9001), np.full(9001, 5.0)]
    )  # longer than the recording: it begins again
    motion = carrier.motion(plan_drive([leg], 0.0, carrier.robot), 0)
    seconds = np.arange(2.0, motion.duration - 2, 1 / RATE)
    poses = motion.poses(seconds)
    yaw, pitch, roll = Rotation.from_matrix(poses[:, :3, :3]).as_euler("ZYX", degrees=True).T
    assert np.abs(yaw - 30).max() < 3 and np.abs(roll).max() < 2
    assert 9 < np.percentile(pitch, 99) < 10.5 and -10.5 < np.percentile(pitch, 1) < -9
    nods = np.sum(np.diff(np.sign(pitch)) > 0) / (seconds[-1] - seconds[0])
    assert nods == pytest.approx(pace / 4, rel=0.1)
    np.testing.assert_allclose(poses[:, :3, 3][:, 1:], np.tile([0.0, 6.2], (len(poses), 1)), atol=0.06)
    assert np.median(np.diff(poses[:, 0, 3])) * RATE == pytest.approx(pace, rel=0.1)
    assert motion.ground(np.array([motion.duration]))[0, 0] == pytest.approx(90.0, abs=0.5)


def test_one_who_is_shaken_turns_fast_meanwhile_and_walks_as_before() -> None:
    leg = np.column_stack([np.linspace(0, 20, 2001), np.zeros((2001, 2))])
    calm = HANDHELD.motion(plan_drive([leg], 0.0, HANDHELD.robot), seed=3)
    moved = calm.shaken(begin=2.0, lasts=4.0)
    seconds = np.arange(0.0, 8.0, 0.01)
    before, after = calm.poses(seconds), moved.poses(seconds)
    assert moved.duration == calm.duration and np.array_equal(before[:, :3, 3], after[:, :3, 3])
    off = Rotation.from_matrix(before[:, :3, :3].swapaxes(1, 2) @ after[:, :3, :3])
    assert not off[(seconds < 2) | (seconds > 6)].magnitude().any()
    rates = np.degrees((off[:-1].inv() * off[1:]).magnitude()) / 0.01
    assert 240 < rates.max() < 330


def test_wrong_names_and_recordings_are_refused(tmp_path: Path) -> None:
    short, still = written(tmp_path / "short.tum", 3.0), written(tmp_path / "still.tum", 20.0, 0.01)
    for call, message in (
        (lambda: Recorded.read(short), "shorter than 5 s"),
        (lambda: Recorded.read(still), "hardly moves"),
        (lambda: Recorded.read(short, 0.0), "pace of 0"),
        (lambda: carrier_named("bicycle"), "'bicycle' is not known"),
        (lambda: carrier_named("handheld", pace=2.0), "not a recording"),
        (lambda: sensor_named("VLP-64"), "'VLP-64' is not known; give one of VLP-16"),
        (lambda: imu_named("best"), "give one of mid360, tactical"),
    ):
        with pytest.raises(UserError, match=message):
            call()
    assert sensor_named("vlp-16") == Sensor()


def walls_off(points: Array, building: SmallBuilding) -> Array:
    """(N,) metres from the nearest of the planes in which all surfaces of the building lie."""
    boxes = np.array(building.solids)
    planes = [np.unique(np.round(boxes[:, [k, k + 3]], 6)) for k in range(3)]
    gaps = [np.abs(building.from_bim(points)[:, k, None] - planes[k]).min(axis=1) for k in range(3)]
    return np.asarray(np.min(gaps, axis=0))


@pytest.mark.parametrize("mount", [(0.0, 0.0, 0.0), (10.0, 20.0, 30.0)])
def test_points_told_with_their_times_are_where_they_are(
    building: SmallBuilding, tmp_path: Path, mount: tuple[float, float, float]
) -> None:
    sensor = Sensor(azimuths=90, rate=20.0, range_noise=0.0)
    run = simulate(
        building.path, "Ground", tmp_path / "run", 1, 2, 10.0, sensor, carrier=HANDHELD, mount_deg=mount, seconds=6.0
    )
    assert len(run.truth) == 120
    R_carrier_sensor = Rotation.from_euler("ZYX", mount[::-1], degrees=True).as_matrix()
    upright = run.truth.poses[:, :3, :3] @ R_carrier_sensor.T  # without the mount
    assert np.median(upright[:, 2, 2]) > 0.98
    moved, stiff = [], []
    for scan, T in zip(ScanFolder(run.out_dir / "scans"), run.truth.poses, strict=True):
        assert scan.point_times is not None
        at = run.truth.at(scan.stamp_ns + np.rint(scan.point_times * 1e9).astype(np.int64))
        moved.append(np.einsum("nij,nj->ni", at[:, :3, :3], scan.points) + at[:, :3, 3])
        stiff.append(scan.points @ T[:3, :3].T + T[:3, 3])
    good, bad = (np.percentile(walls_off(np.concatenate(p), building), 95) for p in (moved, stiff))
    assert good < 0.01 and bad > 3 * good


@pytest.mark.parametrize("name", SENSORS)
def test_every_sensor_has_rays_in_order_of_time(name: str) -> None:
    sensor = SENSORS[name]
    for scan in (0, 7):
        directions, seconds = sensor.rays(scan), sensor.seconds
        np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0)
        assert seconds[0] == 0 and np.all(np.diff(seconds) >= 0) and seconds[-1] < 1 / sensor.rate
        assert 14_000 < len(seconds) < 33_000
    elevation = np.degrees(np.arcsin(directions[:, 2]))
    if name in (known := {"VLP-16": (-15, 15), "OS0-32": (-45, 45), "Mid-360": (-7, 52)}):
        np.testing.assert_allclose([elevation.min(), elevation.max()], known[name], atol=0.6)


def test_a_drive_writes_samples_of_an_imu_that_agree_with_the_truth(building: SmallBuilding, tmp_path: Path) -> None:
    sensor = Sensor(azimuths=40)
    way: dict[str, Any] = {"carrier": HANDHELD, "seconds": 3.0, "mount_deg": (180.0, 0.0, 0.0)}
    run = simulate(building.path, "Ground", tmp_path / "run", 1, sensor=sensor, imu="tactical", **way)
    samples = read_imu(run.out_dir / "scans" / "imu.csv")
    assert samples.stamps_ns[[0, -1]].tolist() == [0, 3_000_000_000]
    assert np.median(samples.accel[:, 2]) < -9.0  # it hangs
    truth = Trajectory.read_tum(run.out_dir / "truth.tum")
    R = Rotation.from_matrix(truth.poses[0, :3, :3])
    for rate in samples.gyro[: int(truth.stamps_ns[-1] / 1e9 * IMU_RATE)]:
        R = R * Rotation.from_rotvec(rate / IMU_RATE)
    assert (R.inv() * Rotation.from_matrix(truth.poses[-1, :3, :3])).magnitude() < 0.01
