"""Readers of what other SLAM systems leave behind: poses, joined to scans, and maps given back to poses."""

from pathlib import Path

import numpy as np
import pytest
from boxes import Array, pose

from data import UserError
from data.scans import ScanFolder
from data.scans.writers import SCAN_WRITERS
from data.slam_output.g2o import read_graph_poses
from data.slam_output.posed_scans import PosedScans, walking_stamps
from data.trajectory.trajectory import PoseList

NS = 10**9
WAY = np.stack([pose(0.5 * k, 0.1 * k**2, 0.8, 0.3 * k) for k in range(8)])
STAMPS = NS * np.arange(5, 13) + 123


def clouds(folder: Path, count: int, stamps: Array | None = None) -> ScanFolder:
    folder.mkdir()
    for k in range(count):
        np.save(folder / f"{k:03d}.npy", np.full((9, 3), 1.0 + k))
    if stamps is not None:
        (folder / "times.txt").write_text("".join(f"{stamp / NS:.9f}\n" for stamp in stamps))
    return ScanFolder(folder)


def test_as_many_clouds_as_poses_belong_together_in_order(tmp_path: Path) -> None:
    scans = PosedScans(clouds(tmp_path / "clouds", 8), PoseList(WAY, STAMPS), "poses")
    found = list(scans)
    assert [scan.stamp_ns for scan in found] == STAMPS.tolist() and scans.note is None
    np.testing.assert_array_equal(np.stack([np.asarray(scan.T_odom_sensor) for scan in found]), WAY)
    unstamped = PosedScans(ScanFolder(tmp_path / "clouds"), PoseList(WAY, None), "poses")
    assert unstamped.note is not None and "1 m/s" in unstamped.note
    assert unstamped.stamps_ns is not None and unstamped.stamps_ns.tolist() == walking_stamps(WAY).tolist()
    assert np.diff(walking_stamps(WAY))[0] == round(np.hypot(0.5, 0.1) * NS)


def test_scans_are_joined_to_poses_by_stamps_and_those_without_are_left_out(tmp_path: Path) -> None:
    times = np.sort([*STAMPS[:4], *(STAMPS[:3] + NS // 2), STAMPS[-1] + 5 * NS])
    scans = PosedScans(clouds(tmp_path / "clouds", 8, times), PoseList(WAY[:5], STAMPS[:5]), "poses")
    found = list(scans)
    assert [scan.stamp_ns for scan in found] == times[:-1].tolist()
    half = next(scan for scan in found if scan.stamp_ns == STAMPS[0] + NS // 2)
    assert half.T_odom_sensor is not None
    np.testing.assert_allclose(half.T_odom_sensor[:3, 3], (WAY[0] + WAY[1])[:3, 3] / 2, atol=1e-6)
    sparse, without = scans.remarks
    assert "more than 0.5 s apart and were taken as they are" in sparse
    assert without == "1 of 8 scans have no pose in poses and were left out"
    with pytest.raises(UserError, match=r"covers 5\.000000123 to .* give poses by their clock"):
        PosedScans(clouds(tmp_path / "later", 5, times[:5] + 100 * NS), PoseList(WAY, STAMPS), "poses")


def test_poses_at_the_ends_of_scans_are_interpolated_to_their_stamps(tmp_path: Path) -> None:
    stamps, last = NS + NS // 10 * np.arange(8), 0.08  # a LiDAR that pauses after each scan
    (folder := tmp_path / "scans").mkdir()
    for k in range(8):
        times = np.linspace(0.0, last, 9).astype(np.float32)
        SCAN_WRITERS["ply"](folder / f"{k:03d}.ply", np.full((9, 3), 1.0 + k, np.float32), times)
    (folder / "times.txt").write_text("".join(f"{stamp / NS:.9f}\n" for stamp in stamps))
    for own in (stamps, None, stamps + 100 * NS):  # its own clock, none, another one
        scans = PosedScans(ScanFolder(folder), PoseList(WAY, own, at_ends=True), "poses")
        found = np.stack([np.asarray(scan.T_odom_sensor) for scan in scans])
        assert scans.given.stamps_ns[0] - (stamps if own is None else own)[0] == pytest.approx(last * NS, abs=10)
        np.testing.assert_allclose(found[1:, :3, 3], (0.8 * WAY[:-1] + 0.2 * WAY[1:])[:, :3, 3], atol=0.03)
    sparse = PosedScans(ScanFolder(folder), PoseList(WAY, STAMPS, at_ends=True), "poses")
    assert sparse.given.stamps_ns.tolist() == STAMPS.tolist() and not sparse.is_dense


def test_a_graph_tells_how_uncertain_its_motions_are(tmp_path: Path) -> None:
    lines = [f"VERTEX_SE3:QUAT {k} {k} 0 0 0 0 0 1" for k in range(3)]
    information = "100 0 0 0 0 0 400 0 0 0 0 25 0 0 0 40000 0 0 40000 0 10000"
    lines += [f"EDGE_SE3:QUAT {k} {k + 1} 1 0 0 0 0 0 1 {information}" for k in range(2)]
    path = tmp_path / "graph.g2o"
    path.write_text("\n".join(lines))
    found = read_graph_poses(path)
    assert found.step_covariances is not None and found.step_covariances[0] is None
    for step in found.step_covariances[1:]:
        np.testing.assert_allclose(np.sqrt(np.diag(np.asarray(step))), [0.01, 0.01, 0.02, 0.1, 0.05, 0.2])
    path.write_text("\n".join(lines).replace(information, "1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 1 0 0 1 0 1"))
    assert read_graph_poses(path).step_covariances == [None, None, None]
