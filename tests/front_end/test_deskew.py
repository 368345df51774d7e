"""Scans of a moving sensor: drawn by the simulator, deskewed by a run."""

import functools
import tempfile
from pathlib import Path

import gtsam
import numpy as np
import pytest
from boxes import Array, pose, room, scene_of
from small_ifc import write_small_ifc

from data import UserError
from data.plans import Bim, load_bim
from data.scans import Scan, ScanFolder
from data.simulation import Robot, SpinningSensor
from data.simulation.sensor import moving_scan
from data.simulation.simulate import simulate
from data.trajectory import Trajectory
from sgslam.geometry.frames import inverse
from sgslam.perception.deskew import checked_times, deskewed, part_of
from sgslam.session import Result
from sgslam.slam import SceneGraphSlam

FAST = Robot(speed=1.8, acceleration=1.5, yaw_rate=1.5, yaw_acceleration=2.5)
SENSOR = SpinningSensor(azimuths=450)
NS = 1_000_000_000


@functools.cache
def fast_drive() -> tuple[Bim, list[Scan], Trajectory]:
    """Through the small building, the sensor moving while it turns."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        building = write_small_ifc(folder / "small.ifc", site=(3000.0, -2000.0, 40.0), yaw=0.5, elevation=3.0)
        run = simulate(
            building.path, "Ground", folder / "run", seed=3, min_rooms=3, min_length=20.0, sensor=SENSOR, robot=FAST,
            effects=("rolling",),
        )  # fmt: skip
        return load_bim(building.path, folder / "cache"), list(ScanFolder(run.out_dir / "scans")), run.truth


@pytest.mark.parametrize("twist", [(0.0, 0.0, 0.0, 1.0, -0.3, 0.1), (0.1, -0.2, 1.5, 1.0, 0.5, -0.2)])
def test_points_seen_under_a_constant_twist_come_to_where_they_are(twist: tuple[float, ...]) -> None:
    rng = np.random.default_rng(0)
    there, seconds = rng.uniform(-5, 5, (200, 3)), rng.uniform(-0.1, 0.1, 200)
    at = [gtsam.Pose3.Expmap(t * np.array(twist)).matrix() for t in seconds]  # T_instant_sensor
    seen = np.stack([inverse(T)[:3, :3] @ p + inverse(T)[:3, 3] for T, p in zip(at, there, strict=True)])
    step = gtsam.Pose3.Expmap(0.2 * np.array(twist)).matrix()
    np.testing.assert_allclose(deskewed(seen, seconds, step, 0.2), there, atol=1e-9)
    np.testing.assert_allclose(part_of(step, -0.5) @ part_of(step, 0.5), np.eye(4), atol=1e-12)


def test_without_motion_nothing_moves() -> None:
    points = np.random.default_rng(1).normal(size=(10, 3))
    np.testing.assert_array_equal(deskewed(points, np.linspace(0, 0.1, 10), np.eye(4), 0.1), points)


@pytest.mark.parametrize("bad", [[0.0, 0.1], [0.0, np.nan, 0.1], [[0.0, 0.1, 0.2]], "abc", [None, 0.0, 0.1]])
def test_times_that_are_none_are_refused(bad: object) -> None:
    with pytest.raises(UserError, match=r"7 ns.*point_times.*\(3,\)"):
        checked_times(bad, 3, 7)  # type: ignore[arg-type]


def test_a_sweep_sees_each_point_from_where_the_sensor_is_then() -> None:
    bounds, sensor = (-3.0, -2.0, 4.0, 2.5), SpinningSensor(azimuths=90, beams=4, range_noise=0.0)
    poses = np.stack([pose(0.4 * a, 0.1, 1.0, 0.5 * a) for a in np.linspace(0, 1, 90, endpoint=False)])
    points, seconds = moving_scan(sensor, scene_of(room(*bounds)), poses, np.random.default_rng(0))
    assert seconds.min() == 0 and seconds.max() < 1 / sensor.rate
    T = poses[np.rint(seconds * sensor.rate * 90).astype(int)]
    there = np.einsum("nij,nj->ni", T[:, :3, :3], points) + T[:, :3, 3]
    box = np.array([[-3.0, 4.0], [-2.0, 2.5], [0.0, 2.6]])
    assert np.abs(there[:, :, None] - box).min(axis=(1, 2)).max() < 1e-4
    still, _ = moving_scan(sensor, scene_of(room(*bounds)), np.repeat(poses[:1], 90, axis=0), np.random.default_rng(0))
    snapshot = sensor.scan(scene_of(room(*bounds)), poses[0], np.random.default_rng(0))
    np.testing.assert_allclose(still, snapshot, atol=1e-5)


def test_rolling_scans_need_a_format_with_times(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="pcd or ply, not bin"):
        simulate(tmp_path / "none.ifc", "Ground", tmp_path / "run", scan_format="bin", effects=("rolling",))


def run(scans: list[Scan], bim: Bim, timed: bool, stretched: float = 1.0) -> Result:
    slam = SceneGraphSlam(bim)
    for scan in scans:
        assert scan.point_times is not None
        slam.add_scan(scan.stamp_ns, scan.points, stretched * scan.point_times if timed else None)
    return slam.finish()


def rmse(result: Result, truth: Trajectory) -> float:
    return float(np.sqrt(np.mean(np.sum((result.trajectory.positions - truth.positions) ** 2, axis=1))))


@pytest.mark.slow
def test_on_a_fast_drive_the_times_of_points_help() -> None:
    bim, scans, truth = fast_drive()
    plain, timed = run(scans, bim, False), run(scans, bim, True)
    assert timed.anchored, timed.reason
    assert timed.trajectory.stamps_ns.tolist() == [scan.stamp_ns for scan in scans]
    assert timed.pose_covariances is not None and plain.anchored
    assert rmse(timed, truth) < 0.02 and rmse(timed, truth) < 0.5 * rmse(plain, truth)
    covered = timed.pose_covariances.trajectory
    places = np.searchsorted(truth.stamps_ns, covered.stamps_ns)
    assert truth.stamps_ns[places].tolist() == covered.stamps_ns.tolist()
    assert np.linalg.norm(covered.positions - truth.positions[places], axis=1).max() < 0.1


def test_times_of_another_unit_are_left_alone() -> None:
    """Of a thousandth, or a share of a turn, taken for seconds: longer than from scan to scan."""
    bim, scans, _ = fast_drive()
    odd, plain = run(scans[:40], bim, True, stretched=10.0), run(scans[:40], bim, False)
    assert odd.trajectory.poses.tobytes() == plain.trajectory.poses.tobytes()


def test_live_poses_are_those_of_the_stamp() -> None:
    bim, scans, truth = fast_drive()
    slam = SceneGraphSlam(bim)
    live = [slam.add_scan(scan.stamp_ns, scan.points, scan.point_times).T_map_sensor for scan in scans[:60]]
    in_map = inverse(truth.poses[0]) @ truth.poses[:60]
    assert np.median(np.linalg.norm((np.stack(live) - in_map)[:, :3, 3], axis=1)) < 0.03


def test_with_odometry_from_outside_scans_are_deskewed_by_it() -> None:
    bim, scans, truth = fast_drive()
    slam = SceneGraphSlam(bim)
    for scan, T in zip(scans, truth.poses, strict=True):
        slam.add_scan(scan.stamp_ns, scan.points, scan.point_times, T_odom_sensor=T)
    result = slam.finish()
    np.testing.assert_array_equal(result.trajectory_odometry.poses, truth.poses)
    assert result.anchored and rmse(result, truth) < 0.02


def test_a_leap_of_a_given_odometry_does_not_tear_a_scan() -> None:
    """The scan with the leap and those after it are found where they are."""
    _, scans, truth = fast_drive()
    given = truth.poses[:60].copy()
    given[30:, :2, 3] += [2.0, -1.0]
    slam = SceneGraphSlam()
    live = [
        slam.add_scan(scan.stamp_ns, scan.points, scan.point_times, T).T_map_sensor
        for scan, T in zip(scans[:60], given, strict=True)
    ]
    in_map = inverse(truth.poses[0]) @ truth.poses[:60]
    assert np.linalg.norm((np.stack(live) - in_map)[:, :3, 3], axis=1).max() < 0.1


def test_a_trajectory_between_its_poses() -> None:
    stamps = (np.array([0.0, 0.5, 1.0]) * NS).astype(np.int64)
    given = Trajectory(stamps, np.stack([pose(t, 0.0, 0.0, 0.5 * t) for t in (0.0, 0.5, 1.0)]))
    asked = np.array([-0.1, 0.0, 0.3, 0.5, 1.0, 1.2])
    expected: Array = np.stack([pose(t, 0.0, 0.0, 0.5 * t) for t in asked])
    np.testing.assert_allclose(given.at((asked * NS).astype(np.int64)), expected, atol=1e-9)
    np.testing.assert_array_equal(given.at(stamps), given.poses)
    with pytest.raises(ValueError, match="1 poses"):
        Trajectory(stamps[:1], given.poses[:1]).at(stamps)
