"""What another SLAM system left behind is anchored to the plan, in every form that is read."""

import json
from pathlib import Path

import numpy as np
import pytest
from boxes import pose
from commands import called, refused
from drives import off, small_drive
from g2o_files import drawn_graph
from slam_outputs import SlamOutput, slam_output, write_poses
from small_ifc import write_small_ifc

from data.geometry.poses import xyzquat_to_poses
from data.trajectory import Trajectory
from sgslam.cli.job.scan_loop import Interruption

pytestmark = pytest.mark.slow
COMMAND = "sgslam.other_slam.anchor"
EXACT = "odometry.given=exact"  # poses as they are


@pytest.fixture(scope="module")
def building(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("building") / "small.ifc"
    return write_small_ifc(path, site=(3000.0, -2000.0, 40.0), yaw=0.5, elevation=3.0).path


def anchored(building: Path, out: Path, *words: object) -> dict[str, object]:
    """What metrics.json says of the call."""
    done = called(COMMAND, *words, "--bim", building, "--out", out)
    assert done.returncode == 0, done.stderr
    metrics = json.loads((out / "metrics.json").read_text())
    assert metrics["anchored"], metrics["reason"]
    return dict(metrics)


def rmse(path: Path) -> float:
    """Metres in the BIM frame, no alignment, of the poses that the command wrote."""
    apart = off(Trajectory.read_tum(path), small_drive().truth)
    return float(np.sqrt(np.mean(np.sum(apart**2, axis=1))))


def drifted() -> SlamOutput:
    """28 cm and 7 degrees off at its end."""
    return slam_output(0.0005, 0.001)


@pytest.mark.parametrize("form", ["tum", "kitti", "euroc"])
def test_poses_with_a_cloud_each_are_anchored(form: str, building: Path, tmp_path: Path) -> None:
    output = drifted()
    before = output.keyframes.transformed(small_drive().truth.poses[0])
    before.write_tum(tmp_path / "before.tum")
    assert rmse(tmp_path / "before.tum") > 0.1
    told = write_poses(output.keyframes, tmp_path, form)
    anchored(building, tmp_path / "out", *told, "--scans", output.write_clouds(tmp_path / "clouds"))
    assert rmse(tmp_path / "out/trajectory.tum") < 0.02
    assert len(Trajectory.read_tum(tmp_path / "out/trajectory.tum")) == len(output.keyframes)
    assert (tmp_path / "out/report.html").is_file()


def test_all_poses_are_anchored_with_those_that_have_a_scan(building: Path, tmp_path: Path) -> None:
    output = drifted()
    clouds, stamps = output.write_clouds(tmp_path / "clouds"), output.keyframes.stamps_ns
    (clouds / "times.txt").write_text("".join(f"{stamp / 1e9:.9f}\n" for stamp in stamps))
    told = write_poses(output.poses, tmp_path, "tum")
    anchored(building, tmp_path / "out", *told, "--scans", clouds)
    everything = tmp_path / "out/trajectory_all.tum"
    assert len(Trajectory.read_tum(everything)) == len(output.poses)
    assert rmse(tmp_path / "out/trajectory.tum") < 0.02 and rmse(everything) < 0.03


def write_all_scans(clouds: Path) -> Path:
    """Those of the whole drive, a fifth of a second apart."""
    clouds.mkdir()
    for k, (_, points) in enumerate(small_drive().scans):
        np.save(clouds / f"{k:06d}.npy", points)
    (clouds / "times.txt").write_text("".join(f"{stamp / 1e9:.9f}\n" for stamp, _ in small_drive().scans))
    return clouds


def test_scans_of_a_whole_drive_are_registered_again(building: Path, tmp_path: Path) -> None:
    output, clouds = slam_output(0.0005, 0.01), write_all_scans(tmp_path / "clouds")
    told = [*write_poses(output.poses, tmp_path, "tum"), "--scans", clouds, "--set", EXACT]
    anchored(building, tmp_path / "single", *told, "--single-pass")
    anchored(building, tmp_path / "again", *told)
    single, again = (rmse(tmp_path / name / "trajectory.tum") for name in ("single", "again"))
    assert again < 0.02 and again < single / 2
    assert (tmp_path / "again/trajectory_live.tum").is_file()


@pytest.mark.long
def test_scans_of_a_whole_drive_put_poses_right_that_jitter(building: Path, tmp_path: Path) -> None:
    poses, rng, clouds = slam_output(0.0005).poses, np.random.default_rng(1), write_all_scans(tmp_path / "clouds")
    off = [pose(*rng.normal(0.0, 0.04, 3), *rng.normal(0.0, 0.015, 3)) for _ in poses.poses]
    told = [*write_poses(Trajectory(poses.stamps_ns, poses.poses @ off), tmp_path, "tum"), "--scans", clouds]
    anchored(building, tmp_path / "measured", *told, "--single-pass")
    assert rmse(tmp_path / "measured/trajectory.tum") < 0.02 and rmse(tmp_path / "measured/trajectory_all.tum") < 0.02
    done = called(COMMAND, *told, "--set", EXACT, "--single-pass", "--bim", building, "--out", tmp_path / "exact")
    assert done.returncode == 0, done.stderr
    metrics = json.loads((tmp_path / "exact/metrics.json").read_text())
    assert not metrics["anchored"] or rmse(tmp_path / "exact/trajectory.tum") > 0.04


def test_a_map_is_given_back_to_the_poses_that_saw_it(building: Path, tmp_path: Path) -> None:
    from data.scans.ply import write_ply

    output = slam_output()
    write_ply(tmp_path / "map.ply", output.map())
    told = write_poses(output.poses, tmp_path, "tum")
    anchored(building, tmp_path / "out", *told, "--cloud", tmp_path / "map.ply")
    assert rmse(tmp_path / "out/trajectory_all.tum") < 0.04
    assert len(Trajectory.read_tum(tmp_path / "out/trajectory_all.tum")) == len(output.poses)


def test_kiss_slams_folder_is_anchored_with_its_own_maps_or_with_the_scans(building: Path, tmp_path: Path) -> None:
    output = slam_output()
    folder = output.write_kiss_slam(tmp_path / "kiss")
    anchored(building, tmp_path / "own", folder)
    assert rmse(tmp_path / "own/trajectory_all.tum") < 0.04
    anchored(building, tmp_path / "scans", folder, "--scans", output.write_clouds(tmp_path / "clouds"))
    assert rmse(tmp_path / "scans/trajectory.tum") < 0.02


def test_glims_dump_is_anchored_by_its_submaps(building: Path, tmp_path: Path) -> None:
    output = slam_output()
    anchored(building, tmp_path / "out", output.write_glim(tmp_path / "dump"))
    assert rmse(tmp_path / "out/trajectory_all.tum") < 0.04
    assert len(Trajectory.read_tum(tmp_path / "out/trajectory_all.tum")) == len(output.poses)


def test_a_graph_of_poses_with_clouds_is_anchored(building: Path, tmp_path: Path) -> None:
    output = drifted()
    graph, clouds = output.write_g2o(tmp_path / "graph.g2o"), output.write_clouds(tmp_path / "clouds")
    (clouds / "times.txt").write_text("".join(f"{stamp / 1e9:.9f}\n" for stamp in output.keyframes.stamps_ns))
    anchored(building, tmp_path / "out", graph, "--scans", clouds)
    assert rmse(tmp_path / "out/trajectory.tum") < 0.02


def test_what_was_interrupted_is_continued_to_the_same_end(
    building: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    output = slam_output()
    told = [output.write_kiss_slam(tmp_path / "kiss"), "--scans", output.write_clouds(tmp_path / "clouds")]
    anchored(building, tmp_path / "whole", *told)
    with monkeypatch.context() as patch:
        asked = iter([False] * 30)  # once a scan
        patch.setattr(Interruption, "__bool__", lambda self: next(asked, True))
        done = called(COMMAND, *told, "--bim", building, "--out", tmp_path / "out")
    assert done.returncode == 2 and "interrupted after" in done.stderr, done.stderr
    done = called("sgslam.run", "--resume", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    for name in ("trajectory.tum", "trajectory_all.tum"):
        assert (tmp_path / "out" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()


def test_a_graph_of_s_graphs_is_anchored_by_its_planes(tmp_path: Path) -> None:
    drawn = drawn_graph()
    graph, plan = drawn.write(tmp_path)
    metrics = anchored(plan, tmp_path / "out", graph)
    assert metrics["keyframes"] == len(drawn.keyframes)
    rows = np.loadtxt(tmp_path / "out/keyframes.txt")
    found = dict(zip(rows[:, 0].astype(int).tolist(), xyzquat_to_poses(rows[:, 1:]), strict=True))
    errors = [np.linalg.norm((found[i] - true)[:2, 3]) for i, true in drawn.keyframes.items()]
    assert max(errors) < 0.01 and json.loads((tmp_path / "out/matches.json").read_text())["status"] == "unique"


def test_a_graph_that_fits_nowhere_is_told_and_not_placed(building: Path, tmp_path: Path) -> None:
    graph, _ = drawn_graph().write(tmp_path)
    done = called(COMMAND, graph, "--bim", building, "--out", tmp_path / "out", "--strict")
    assert done.returncode == 3 and done.stderr.endswith("--strict: exit code 3: not anchored\n")
    assert not (tmp_path / "out/keyframes.txt").exists()
    assert not json.loads((tmp_path / "out/metrics.json").read_text())["anchored"]


def test_a_mistake_is_told_in_a_line_that_says_what_to_do(building: Path, tmp_path: Path) -> None:
    output = slam_output()
    (poses,) = write_poses(output.keyframes, tmp_path, "tum")
    clouds = output.write_clouds(tmp_path / "clouds")
    (clouds / "000000.npy").unlink()
    kitti = write_poses(output.keyframes, tmp_path, "kitti")[0]
    (tmp_path / "times.txt").unlink()
    folder, end = tmp_path / "empty", ["--bim", building, "--out", tmp_path / "out"]
    folder.mkdir()
    assert "give --scans" in refused(COMMAND, poses, *end)
    assert "neither KISS-SLAM's" in refused(COMMAND, folder, *end)
    assert "--bim is missing" in refused(COMMAND, poses)
    assert "no such file" in refused(COMMAND, tmp_path / "none.tum", *end)
    said = refused(COMMAND, kitti, "--scans", clouds, *end)
    assert f"{len(output.keyframes)} poses for the {len(output.keyframes) - 1} scans" in said
    graph, plan = drawn_graph().write(tmp_path)
    assert "has no effect" in refused(COMMAND, graph, "--bim", plan, "--mount", "0,0,0")
