"""What a run leaves, in the forms of other programs: each is read back by a library that is not ours."""

import shutil
from pathlib import Path

import evo.tools.file_interface as evo
import gtsam
import numpy as np
import pytest
import trimesh
from commands import called, refused
from drives import fed, small_drive
from shared_runs import written_once

from data.common.errors import UserError
from data.geometry.poses import xyzquat_to_poses
from data.trajectory import Trajectory
from sgslam.backend import HeldFactors, write_pose_graph
from sgslam.cli.export import export
from sgslam.mapping.keyframe_clouds import FILE as CLOUDS
from sgslam.report import RunFolder
from sgslam.slam import SceneGraphSlam

NAMES = {"map.ply", "trajectory.kitti", "trajectory_euroc.csv", "trajectory_times.txt"}


@pytest.fixture(scope="session")
def out(anchored_run: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The anchored run's folder, with all that is exported without its model."""

    def write(folder: Path) -> None:
        for path in (anchored_run / "out").iterdir():
            (folder / path.name).symlink_to(path)
        before = {path.name for path in folder.iterdir()}
        done = called("sgslam.cli.export", "--out", folder, "--format", "all")
        assert done.returncode == 0, done.stderr
        assert {path.name for path in folder.iterdir()} - before == NAMES
        assert all(name in done.stdout for name in NAMES) and "ifc: left out; give the run's model" in done.stdout

    return written_once(tmp_path_factory, "exported_run", write)


@pytest.fixture(scope="session")
def run(out: Path) -> RunFolder:
    return RunFolder.read(out)


@pytest.fixture(scope="module")
def map_only(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a short run without a plan."""
    folder = tmp_path_factory.mktemp("map_only")
    fed(SceneGraphSlam(), small_drive().scans[:40]).finish().save(folder)
    return folder


@pytest.fixture
def folder(map_only: Path, tmp_path: Path) -> Path:
    """Its files, which may be replaced."""
    return shutil.copytree(map_only, tmp_path / "folder")


def test_trajectories_are_those_that_evo_reads(out: Path) -> None:
    written = Trajectory.read_tum(out / "trajectory.tum")
    kitti = evo.read_kitti_poses_file(str(out / "trajectory.kitti"))
    euroc = evo.read_euroc_csv_trajectory(str(out / "trajectory_euroc.csv"))
    for read in (kitti, euroc):
        np.testing.assert_allclose(read.poses_se3, written.poses, atol=1e-9)
    for times in (np.loadtxt(out / "trajectory_times.txt"), euroc.timestamps):
        np.testing.assert_allclose(times, written.stamps_ns / 1e9, rtol=0, atol=1e-6)


def test_gtsam_loads_the_pose_graph(run: RunFolder) -> None:
    graph, values = gtsam.readG2o(str(run.path / "pose_graph.g2o"), True)
    poses = np.stack([values.atPose3(i).matrix() for i in range(values.size())])
    np.testing.assert_allclose(poses, run.keyframe_poses, atol=1e-6)
    for i in range(graph.size()):
        first, second = graph.at(i).keys()
        step = np.linalg.inv(poses[first]) @ poses[second]
        np.testing.assert_allclose(graph.at(i).measured().matrix(), step, atol=0.1)


def test_information_is_in_the_order_and_the_units_of_g2o(tmp_path: Path) -> None:
    """gtsam has the rotation first, in radians; g2o the translation, and half the angle."""
    noise = gtsam.noiseModel.Diagonal.Sigmas(np.array([0.01, 0.02, 0.03, 0.1, 0.2, 0.3]))
    turn, x = gtsam.Pose3(gtsam.Rot3.Rz(0.5), np.array([1.0, 2.0, 3.0])), [gtsam.symbol("x", i) for i in range(2)]
    held: HeldFactors = {"odometry": {(1,): gtsam.BetweenFactorPose3(*x, turn, noise)}}
    assert write_pose_graph(tmp_path / "g", held, np.tile(np.eye(4), (2, 1, 1))) == 1
    line = [float(word) for word in (tmp_path / "g").read_text().splitlines()[2].split()[1:]]
    np.testing.assert_allclose(xyzquat_to_poses(line[2:9]), turn.matrix(), atol=1e-12)
    sigmas = np.array([0.1, 0.2, 0.3, 0.01 / 2, 0.02 / 2, 0.03 / 2])
    np.testing.assert_allclose(line[9:], np.diag(1 / sigmas**2)[np.triu_indices(6)], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("metrics.json", '{"T_bim_map": [0, 0, 0]}', "no run's folder"),
        ("matches.json", "[]", "no run's folder"),
        ("s_graph.json", "{", "s_graph.json"),
        ("trajectory.tum", "1 2 3\n", "trajectory.tum, line 1"),
        (CLOUDS, "SGKC", CLOUDS),
        ("config.yaml", "clouds: [", "config.yaml"),
        ("metrics.json", '{"T_bim_map": null}', "was not anchored"),
    ],
)
def test_damaged_folders_are_refused(folder: Path, name: str, content: str, message: str) -> None:
    (folder / name).write_text(content)
    with pytest.raises(UserError, match=message):
        export(folder, ["kitti", "ply", "ifc"], folder / "x.ifc")


def test_a_run_that_was_not_anchored_is_exported_in_the_maps_frame_or_refused(folder: Path) -> None:
    export(folder, ["all"], Path("x.ifc"))
    assert np.abs(trimesh.load(folder / "map.ply").vertices).max() < 30.0
    words = ("sgslam.cli.export", "--out", folder, "--format")
    assert "--bim" in refused(*words, "ifc") and "--voxel" in refused(*words, "ply", "--voxel", "0")
