"""Trajectories: files of poses in every form, what is refused, and motions of them."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from data.common.errors import UserError
from data.trajectory import Trajectory
from data.trajectory.trajectory import moved_with, read_poses, write_kitti

STAMPS = 1_700_000_000_000_000_001 + np.cumsum(np.random.default_rng(1).integers(1, 10**9, 50))


def random_poses(count: int, seed: int = 0, scale: float = 10.0) -> NDArray[np.float64]:
    rng = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Rotation.random(count, rng=rng).as_matrix()
    poses[:, :3, 3] = rng.normal(scale=scale, size=(count, 3))
    return poses


@pytest.mark.parametrize("form", ["tum", "kitti"])
@pytest.mark.parametrize("scale", [1e-3, 10.0, 5e6])
def test_poses_are_read_as_they_were_written(form: str, scale: float, tmp_path: Path) -> None:
    trajectory, path, times = Trajectory(STAMPS, random_poses(50, scale=scale)), tmp_path / "poses", tmp_path / "times"
    if form == "kitti":
        write_kitti(trajectory, path, times)
        assert read_poses(path).stamps_ns is None
    else:
        trajectory.write_tum(path)
        assert {len(line.split()) for line in path.read_text().splitlines()} == {8}
    found = read_poses(path, times if form == "kitti" else None)
    assert found.stamps_ns is not None and found.stamps_ns.tolist() == STAMPS.tolist()
    np.testing.assert_allclose(found.poses[:, :3, 3], trajectory.positions, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(found.poses[:, :3, :3], trajectory.poses[:, :3, :3], atol=1e-8)
    if form != "kitti":
        with pytest.raises(UserError, match="stamps of its own"):
            read_poses(path, times)


def test_tum_of_others_with_comments_and_loose_quaternions(tmp_path: Path) -> None:
    (tmp_path / "t.tum").write_text(
        "# t x y z qx qy qz qw\n\n-0.5 1 2 3 0 0 0 2\n  2e0\t4 5 6 0 0 1.0001 1  # turned left\n"
    )
    read = Trajectory.read_tum(tmp_path / "t.tum")
    assert read.stamps_ns.tolist() == [-500_000_000, 2_000_000_000]
    assert np.array_equal(read.poses[0, :3], np.c_[np.eye(3), [1, 2, 3]])
    assert np.allclose(read.poses[1, :3, 0], [0, 1, 0], atol=1e-3)
    assert np.linalg.det(read.poses[1, :3, :3]) == pytest.approx(1, abs=1e-12)


EYE = "1 0 0 0 0 1 0 0 0 0 1 "


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "nothing in it"),
        (b"\xff\xfe\x00\x81", "poses"),
        (b"1 0 0 0 0 0 0 1\n2 0 0 0 0 0 1\n", "line 2: 7 values"),
        (b"1 0 0 0 0 0 0 1\n\n1 0 0 0 0 0 0 1\n", "line 3: the stamp repeats"),
        (b"2 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n", "line 2: the stamp goes backwards"),
        (b"1 0 nan 0 0 0 0 1\n", "line 1: a value is not finite"),
        (b"1 0 0 0 0 0 0 0\n", "line 1: the quaternion"),
        (b"1700000000000000000 0 0 0 0 0 0 1\n", "line 1: .* not a stamp in seconds"),
        (f"{EYE}0\n1 0 0 0 0 2 0 0 0 0 1 0\n".encode(), "line 2: a pose is not a rigid transform"),
        (b"5,0,0,0,1,0,0,0\n", "evo_traj euroc"),
    ],
)
def test_a_wrong_file_is_refused_with_its_line(content: bytes, message: str, tmp_path: Path) -> None:
    (tmp_path / "poses").write_bytes(content)
    with pytest.raises(UserError, match=message) as caught:
        read_poses(tmp_path / "poses")
    assert "poses" in str(caught.value) and "\n" not in str(caught.value)
    for missing in (tmp_path / "none.tum", tmp_path):
        with pytest.raises(UserError):
            Trajectory.read_tum(missing)


def test_improper_poses_are_refused() -> None:
    mirrored, scaled, endless = (random_poses(3) for _ in range(3))
    mirrored[1, :3, 0] *= -1
    scaled[1, :3, :3] *= 1.01
    endless[1, 0, 3] = np.nan
    for poses in (mirrored, scaled, endless, random_poses(2)):
        with pytest.raises(ValueError, match="trajectory"):
            Trajectory(np.arange(3), poses)
    with pytest.raises(ValueError, match="stamps"):
        Trajectory(np.array([0, 2, 1]), random_poses(3))


def test_transformed_moves_the_frame_and_a_correction_the_poses_between() -> None:
    trajectory, T_new_old = Trajectory(STAMPS, random_poses(50)), random_poses(1, seed=3, scale=3000.0)[0]
    moved = trajectory.transformed(T_new_old)
    assert np.allclose(moved.positions, trajectory.positions @ T_new_old[:3, :3].T + T_new_old[:3, 3])
    assert np.allclose(*[np.linalg.inv(t.poses[0]) @ t.poses[-1] for t in (trajectory, moved)])
    carried = moved_with(trajectory, moved.only(np.arange(50) % 3 == 0))
    np.testing.assert_allclose(carried.poses, moved.poses, atol=1e-6)
    assert carried.stamps_ns.tolist() == STAMPS.tolist()
    one = moved_with(trajectory, moved.only(np.arange(50) == 7))
    np.testing.assert_allclose(one.poses, moved.poses, atol=1e-6)
