"""Association by time, alignment, and the accuracy of a run against numbers that evo computes."""

import numpy as np
import pytest
from boxes import Array
from scipy.spatial.transform import Rotation

from data.common.errors import UserError
from data.geometry.poses import xyzquat_to_poses
from data.trajectory import Trajectory
from sgslam.geometry.trajectory_errors import accuracy, align_se3, associate, yaw_errors

MS = 1_000_000
T0 = 1_700_000_000_000_000_000


def motion(seed: int) -> Array:
    rng = np.random.default_rng(seed)
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(rng.normal(size=3) * 3.0).as_matrix()
    T[:3, 3] = rng.normal(size=3) * 20.0
    return T


def walk(count: int = 200) -> Trajectory:
    """A flat figure of eight at 10 Hz, heading along its way."""
    s = np.linspace(0, 2 * np.pi, count)
    xyz = np.stack([8 * np.sin(s), 4 * np.sin(2 * s), np.full(count, 0.8)], axis=1)
    heading = np.arctan2(8 * np.cos(2 * s), 8 * np.cos(s))
    quaternions = Rotation.from_rotvec(np.outer(heading, [0, 0, 1])).as_quat()
    return Trajectory(T0 + np.arange(count) * 100 * MS, xyzquat_to_poses(np.hstack([xyz, quaternions])))


def jittered(trajectory: Trajectory, seed: int = 0, metres: float = 0.05) -> Trajectory:
    rng = np.random.default_rng(seed)
    poses = trajectory.poses.copy()
    poses[:, :3, 3] += rng.normal(scale=metres, size=(len(poses), 3))
    turns = Rotation.from_rotvec(rng.normal(scale=0.02, size=(len(poses), 3))).as_matrix()
    poses[:, :3, :3] = turns @ poses[:, :3, :3]
    return Trajectory(trajectory.stamps_ns, poses)


def test_association_is_one_to_one_exact_at_the_tolerance_and_in_nanoseconds() -> None:
    estimate = T0 + np.array([0, 90, 104, 195, 300, 412]) * MS
    truth = T0 + np.array([-5, 100, 199, 230, 500]) * MS
    ours, true = associate(estimate, truth, 10 * MS)
    assert ours.tolist() == [0, 2, 3] and true.tolist() == [0, 1, 2]
    first = estimate[:1]
    found = [len(associate(first, first + off, 10 * MS)[0]) for off in (10 * MS, 10 * MS + 1, -10 * MS)]
    assert found == [1, 0, 1] and len(associate(first[:0], truth)[0]) == len(associate(first, truth[:0])[0]) == 0


def test_alignment_recovers_a_motion_and_never_mirrors_or_guesses() -> None:
    points, T, noise = walk().positions, motion(0), np.random.default_rng(0).normal(size=(100, 3))
    assert np.allclose(align_se3(points, points @ T[:3, :3].T + T[:3, 3]), T, atol=1e-8)
    assert np.linalg.det(align_se3(noise, noise * [1, 1, -1])) == pytest.approx(1)
    line = np.outer(np.linspace(0, 30, 100), [1, 2, 0.1])
    for undetermined, message in ((noise * 0.01, "too little motion"), (line + noise * 5e-3, "straight line")):
        with pytest.raises(UserError, match=message):
            align_se3(undetermined, undetermined)


def test_errors_in_the_bim_frame_are_not_aligned() -> None:
    truth = walk()
    shifted = truth.transformed(xyzquat_to_poses([0.3, 0.4, 0, 0, 0, 0, 1]))
    result = accuracy(shifted, shifted, truth.transformed(motion(2)), truth)
    assert result["rmse_bim_m"] == pytest.approx(0.5) and result["max_bim_m"] == pytest.approx(0.5)
    assert result["yaw_rmse_bim_deg"] == pytest.approx(0, abs=1e-6)
    assert result["rmse_odometry_aligned_m"] == pytest.approx(0, abs=1e-9)
    part = Trajectory(truth.stamps_ns[50:90] + 4 * MS, truth.poses[50:90])
    result = accuracy(truth, truth, truth, part)
    assert (result["matched_poses"], result["total_poses"]) == (40, 200)


@pytest.mark.parametrize("mounting", [[np.pi, 0, 0], [0.3, 1.0, -2.0]])
def test_yaw_is_about_the_plans_z_however_the_sensor_is_mounted(mounting: list[float]) -> None:
    T, turned = np.eye(4), np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(mounting).as_matrix()
    turned[:3, :3] = Rotation.from_euler("z", 3.0).as_matrix()
    assert np.allclose(yaw_errors(turned @ walk().poses @ T, walk().poses @ T), 3.0)


def test_what_is_not_known_is_null_and_says_why() -> None:
    truth = walk()
    in_map = jittered(truth, seed=1, metres=0.01).transformed(motion(5))
    result = accuracy(None, in_map, jittered(truth).transformed(motion(3)), truth)
    assert result["rmse_bim_m"] is result["max_bim_m"] is result["yaw_rmse_bim_deg"] is None
    assert 0.05 < result["rmse_odometry_aligned_m"] < 0.12 and 0.01 < result["rmse_map_aligned_m"] < 0.024
    poses = np.tile(np.eye(4), (50, 1, 1))
    poses[:, 0, 3] = np.linspace(0, 10, 50)
    straight = Trajectory(T0 + np.arange(50) * 100 * MS, poses)
    result = accuracy(straight, straight, straight, straight)
    assert result["rmse_bim_m"] == 0 and "straight line" in result["note"]
    assert result["rmse_odometry_aligned_m"] is result["rmse_map_aligned_m"] is None
    restarted = accuracy(None, truth, None, truth)
    assert restarted["rmse_odometry_aligned_m"] is None and "restarted" in restarted["note"]
    assert restarted["rmse_map_aligned_m"] == pytest.approx(0.0, abs=1e-6)
    with pytest.raises(UserError, match="clock"):
        accuracy(truth, truth, truth, Trajectory(truth.stamps_ns - T0, truth.poses))
