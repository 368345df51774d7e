"""Trajectories: what is refused, TUM files there and back, and poses as seven numbers."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from data.common.errors import UserError
from data.geometry.poses import poses_to_xyzquat, xyzquat_to_poses
from data.trajectory import Trajectory


def random_poses(count: int, seed: int = 0, scale: float = 10.0) -> NDArray[np.float64]:
    rng = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Rotation.random(count, rng=rng).as_matrix()
    poses[:, :3, 3] = rng.normal(scale=scale, size=(count, 3))
    return poses


STAMPS = 1_700_000_000_000_000_001 + np.cumsum(np.random.default_rng(1).integers(1, 10**9, 50))


@pytest.mark.parametrize("scale", [1e-3, 10.0, 5e6])
def test_tum_there_and_back(scale: float, tmp_path: Path) -> None:
    written = Trajectory(STAMPS, random_poses(50, scale=scale))
    written.write_tum(tmp_path / "t.tum")
    read = Trajectory.read_tum(tmp_path / "t.tum")
    assert np.array_equal(read.stamps_ns, STAMPS)
    assert np.allclose(read.positions, written.positions, rtol=1e-9, atol=0)
    assert np.allclose(read.poses[:, :3, :3], written.poses[:, :3, :3], atol=1e-9)


def test_tum_lines_have_eight_numbers_a_pose(tmp_path: Path) -> None:
    Trajectory(np.array([-1, 5]), random_poses(2)).write_tum(tmp_path / "t.tum")
    lines = (tmp_path / "t.tum").read_text().splitlines()
    assert [len(line.split()) for line in lines] == [8, 8]
    assert [line.split()[0] for line in lines] == ["-0.000000001", "0.000000005"]
    assert Trajectory.read_tum(tmp_path / "t.tum").stamps_ns.tolist() == [-1, 5]


def test_tum_of_others_with_comments_and_loose_quaternions(tmp_path: Path) -> None:
    (tmp_path / "t.tum").write_text(
        "# t x y z qx qy qz qw\n\n1.5 1 2 3 0 0 0 2\n  2e0\t4 5 6 0 0 1.0001 1  # turned left\n"
    )
    read = Trajectory.read_tum(tmp_path / "t.tum")
    assert read.stamps_ns.tolist() == [1_500_000_000, 2_000_000_000]
    assert np.array_equal(read.poses[0, :3], np.c_[np.eye(3), [1, 2, 3]])
    assert np.allclose(read.poses[1, :3, 0], [0, 1, 0], atol=1e-3)
    assert np.linalg.det(read.poses[1, :3, :3]) == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no poses"),
        ("# nothing\n", "no poses"),
        ("1 0 0 0 0 0 0 1\n2 0 0 0 0 0 1\n", "line 2: 7 values"),
        ("1 0 0 0 0 0 0 1\n\n1 0 0 0 0 0 0 1\n", "line 3: the stamp repeats"),
        ("2 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n", "line 2: the stamp goes backwards"),
        ("1 0 nan 0 0 0 0 1\n", "line 1: a value is not finite"),
        ("1 0 x 0 0 0 0 1\n", "line 1: a value is not a number"),
        ("1 0 0 0 0 0 0 0\n", "line 1: the quaternion"),
        ("1700000000000000000 0 0 0 0 0 0 1\n", "line 1: .* not a stamp in seconds"),
    ],
)
def test_bad_tum_is_refused_with_its_line(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "t.tum").write_text(text)
    with pytest.raises(UserError, match=message) as caught:
        Trajectory.read_tum(tmp_path / "t.tum")
    assert "t.tum" in str(caught.value) and "\n" not in str(caught.value)


def test_files_that_are_no_text(tmp_path: Path) -> None:
    (tmp_path / "t.tum").write_bytes(b"\xff\xfe\x00\x81")
    for path in (tmp_path / "t.tum", tmp_path / "none.tum", tmp_path):
        with pytest.raises(UserError):
            Trajectory.read_tum(path)


def improper(kind: str) -> NDArray[np.float64]:
    poses = random_poses(3)
    if kind == "mirror":
        poses[1, :3, 0] *= -1
    elif kind == "scaled":
        poses[1, :3, :3] *= 1.01
    elif kind == "not finite":
        poses[1, 0, 3] = np.nan
    elif kind == "last row":
        poses[1, 3, 0] = 1
    return poses if kind != "count" else poses[:2]


@pytest.mark.parametrize("kind", ["mirror", "scaled", "not finite", "last row", "count"])
def test_improper_poses_are_refused(kind: str) -> None:
    with pytest.raises(ValueError, match="trajectory"):
        Trajectory(np.arange(3), improper(kind))


@pytest.mark.parametrize("stamps", [[0, 1, 1], [0, 2, 1], [0.0, 1.0, 2.0]])
def test_stamps_must_be_integers_that_increase(stamps: list[float]) -> None:
    with pytest.raises(ValueError, match="stamps"):
        Trajectory(np.array(stamps), random_poses(3))


def test_a_trajectory_keeps_its_own_copy() -> None:
    stamps, poses = np.arange(3), random_poses(3)
    trajectory = Trajectory(stamps, poses)
    stamps[0], poses[0, 0, 3] = -9, 99
    assert trajectory.stamps_ns[0] == 0 and trajectory.positions[0, 0] != 99
    with pytest.raises(ValueError):
        trajectory.poses[0, 0, 3] = 1


def test_transformed_moves_the_frame_and_not_the_motion() -> None:
    trajectory = Trajectory(np.arange(5), random_poses(5))
    T_new_old = random_poses(1, seed=3)[0]
    moved = trajectory.transformed(T_new_old)
    assert np.allclose(moved.positions, trajectory.positions @ T_new_old[:3, :3].T + T_new_old[:3, 3])
    steps = [np.linalg.inv(t.poses[0]) @ t.poses[-1] for t in (trajectory, moved)]
    assert np.allclose(*steps)


def test_seven_numbers_there_and_back() -> None:
    poses = random_poses(20).reshape(4, 5, 4, 4)
    numbers = poses_to_xyzquat(poses)
    assert numbers.shape == (4, 5, 7) and np.all(numbers[..., 6] >= 0)
    assert np.allclose(xyzquat_to_poses(numbers), poses)
    assert np.allclose(poses_to_xyzquat(poses[0, 0]), numbers[0, 0])
    turned = xyzquat_to_poses([0, 0, 0, 0, 0, np.sin(np.pi / 8), np.cos(np.pi / 8)])
    assert np.allclose(turned[:3, :3] @ [1, 0, 0], [np.cos(np.pi / 4), np.sin(np.pi / 4), 0])
    assert poses_to_xyzquat(np.empty((0, 4, 4))).shape == (0, 7)


def test_what_lies_between_anothers_first_and_last_stamp() -> None:
    poses = np.tile(np.eye(4), (5, 1, 1))
    truth = Trajectory(np.array([0, 10, 20, 30, 40]), poses)
    run = Trajectory(np.array([9, 31]), poses[:2])
    assert truth.between(run).stamps_ns.tolist() == [10, 20, 30]
    assert len(truth.between(Trajectory(np.empty(0, np.int64), poses[:0]))) == 0
