"""KITTI and EuRoC trajectories: there and back, as evo reads them, and what is refused."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from data.common.errors import UserError
from data.trajectory import Trajectory
from evaluation.harness.formats import read_euroc, read_kitti, write_euroc, write_kitti

STAMPS = 1_403_636_580_838_555_648 + np.cumsum(np.random.default_rng(1).integers(1, 10**9, 40))
IDENTITY = "1 0 0 0 0 1 0 0 0 0 1 0"


@pytest.fixture(scope="module")
def trajectory() -> Trajectory:
    poses = np.tile(np.eye(4), (40, 1, 1))
    poses[:, :3, :3] = Rotation.random(40, rng=np.random.default_rng(0)).as_matrix()
    poses[:, :3, 3] = np.random.default_rng(2).normal(scale=1e4, size=(40, 3))
    return Trajectory(STAMPS, poses)


def test_kitti_there_and_back(trajectory: Trajectory, tmp_path: Path) -> None:
    write_kitti(trajectory, tmp_path / "poses.txt", tmp_path / "times.txt")
    read = read_kitti(tmp_path / "poses.txt", tmp_path / "times.txt")
    assert np.array_equal(read.stamps_ns, STAMPS)
    assert np.allclose(read.poses, trajectory.poses, rtol=1e-12, atol=1e-14)


def test_euroc_there_and_back(trajectory: Trajectory, tmp_path: Path) -> None:
    write_euroc(trajectory, tmp_path / "data.csv")
    read = read_euroc(tmp_path / "data.csv")
    assert np.array_equal(read.stamps_ns, STAMPS)
    assert np.allclose(read.poses, trajectory.poses, rtol=1e-12, atol=1e-14)


def test_evo_reads_what_we_write(trajectory: Trajectory, tmp_path: Path) -> None:
    pytest.importorskip("evo", reason="evo is a development extra")
    from evo.tools import file_interface

    write_kitti(trajectory, tmp_path / "poses.txt", tmp_path / "times.txt")
    write_euroc(trajectory, tmp_path / "data.csv")
    trajectory.write_tum(tmp_path / "t.tum")
    kitti = file_interface.read_kitti_poses_file(tmp_path / "poses.txt")
    euroc = file_interface.read_euroc_csv_trajectory(tmp_path / "data.csv")
    tum = file_interface.read_tum_trajectory_file(tmp_path / "t.tum")
    for theirs in (kitti, euroc, tum):
        assert np.allclose(np.array(theirs.poses_se3), trajectory.poses, rtol=1e-9, atol=1e-9)
    assert np.allclose(euroc.timestamps, STAMPS / 1e9) and np.allclose(tum.timestamps, STAMPS / 1e9)


def test_we_read_what_evo_writes(trajectory: Trajectory, tmp_path: Path) -> None:
    pytest.importorskip("evo", reason="evo is a development extra")
    from evo.core.trajectory import PosePath3D
    from evo.tools import file_interface

    file_interface.write_kitti_poses_file(tmp_path / "poses.txt", PosePath3D(poses_se3=list(trajectory.poses)))
    (tmp_path / "times.txt").write_text("".join(f"{k / 10:e}\n" for k in range(40)))
    read = read_kitti(tmp_path / "poses.txt", tmp_path / "times.txt")
    assert np.allclose(read.poses, trajectory.poses, atol=1e-9)
    assert read.stamps_ns.tolist() == [k * 10**8 for k in range(40)]


def test_rounded_rotations_become_exact(trajectory: Trajectory, tmp_path: Path) -> None:
    rows = trajectory.poses[:, :3].reshape(-1, 12)
    (tmp_path / "poses.txt").write_text("".join(" ".join(f"{v:.6e}" for v in row) + "\n" for row in rows))
    (tmp_path / "times.txt").write_text("".join(f"{k}\n" for k in range(40)))
    R = read_kitti(tmp_path / "poses.txt", tmp_path / "times.txt").poses[:, :3, :3]
    assert np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max() < 1e-14
    assert np.abs(R - trajectory.poses[:, :3, :3]).max() < 2e-6


def test_the_files_that_euroc_ships(tmp_path: Path) -> None:
    (tmp_path / "data.csv").write_bytes(
        b"#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], v_x\r\n"
        b"1403636580838555648,4.688319,-1.786938,0.783338,0.534108,-0.153029,-0.827383,-0.082152,-0.027876\r\n"
        b"1403636580843555648, 4.688177, -1.786770, 0.787350, 0.534640, -0.152990, -0.826976, -0.082863, 0.03\r\n"
    )
    read = read_euroc(tmp_path / "data.csv")
    assert read.stamps_ns.tolist() == [1403636580838555648, 1403636580843555648]
    quaternion = Rotation.from_matrix(read.poses[0, :3, :3]).as_quat(canonical=True)
    assert np.allclose(quaternion, [-0.153029, -0.827383, -0.082152, 0.534108], atol=1e-6)


@pytest.mark.parametrize(
    ("poses", "times", "message"),
    [
        ("", "0\n", "no poses"),
        (f"{IDENTITY}\n1 0 0 0 0 1 0 0 0 0 1\n", "0\n1\n", "line 2: 11 values"),
        (f"{IDENTITY}\n\n{IDENTITY} 0\n", "0\n1\n", "line 3: 13 values"),
        (IDENTITY.replace("0 1 0 0", "0 x 0 0"), "0\n", "line 1: a value is not a number"),
        ("1 0 0 nan 0 1 0 0 0 0 1 0", "0\n", "line 1: a value is not finite"),
        ("1 0 0 0 0 1 0 0 0 0 -1 0", "0\n", "line 1: its 3 x 3 part is not a rotation"),
        ("1 0 0 0 0 1.1 0 0 0 0 1 0", "0\n", "not a rotation"),
        (f"{IDENTITY}\n{IDENTITY}\n", "0\n", "1 times for the 2 poses"),
        (f"{IDENTITY}\n{IDENTITY}\n", "0\n1\n2\n", "3 times for the 2 poses"),
        (f"{IDENTITY}\n{IDENTITY}\n", "1\n1\n", "the stamp repeats from line 1"),
        (f"{IDENTITY}\n{IDENTITY}\n", "1\n0\n", "goes backwards"),
        (f"{IDENTITY}\n{IDENTITY}\n", "1\none\n", "line 2"),
    ],
)
def test_kitti_files_that_are_refused(tmp_path: Path, poses: str, times: str, message: str) -> None:
    (tmp_path / "poses.txt").write_text(poses)
    (tmp_path / "times.txt").write_text(times)
    with pytest.raises(UserError, match=message):
        read_kitti(tmp_path / "poses.txt", tmp_path / "times.txt")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("#timestamp\n", "no poses"),
        ("timestamp,x,y,z,qw,qx,qy,qz\n1,0,0,0,1,0,0,0\n", "line 1: the stamp 'timestamp'"),
        ("1,0,0,0,1,0,0\n", "line 1: 7 values"),
        ("1 0 0 0 1 0 0 0\n", "line 1: 1 values"),
        ("1,0,0,0,1,0,0,0,5\n2,0,0,0,1,0,0,0\n", "line 2: 8 values, where the lines before have 9"),
        ("1.5,0,0,0,1,0,0,0\n", "not whole nanoseconds"),
        ("1.4e18,0,0,0,1,0,0,0\n", "not whole nanoseconds"),
        ("99999999999999999999,0,0,0,1,0,0,0\n", "too large"),
        ("--1,0,0,0,1,0,0,0\n", "not whole nanoseconds"),
        ("1,0,0,0,1,0,0,inf\n", "not finite"),
        ("1,0,,0,1,0,0,0\n", "not a number"),
        ("1,0,0,0,0,0,0,0\n", "no direction"),
        ("2,0,0,0,1,0,0,0\n1,0,0,0,1,0,0,0\n", "goes backwards from line 1"),
    ],
)
def test_euroc_files_that_are_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "data.csv").write_text(text)
    with pytest.raises(UserError, match=message):
        read_euroc(tmp_path / "data.csv")


def test_files_that_are_not_there_or_not_text(tmp_path: Path) -> None:
    (tmp_path / "binary").write_bytes(bytes(range(256)))
    for name, message in (("missing", "cannot be read"), ("binary", "not a text file")):
        with pytest.raises(UserError, match=message):
            read_euroc(tmp_path / name)
        with pytest.raises(UserError, match=message):
            read_kitti(tmp_path / name, tmp_path / name)
