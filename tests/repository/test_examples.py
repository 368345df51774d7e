"""The examples as a user calls them."""

import os
import re
import subprocess
import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from drives import Drive, fed, small_drive
from g2o_files import drawn_graph
from small_ifc import write_small_ifc

from data import SceneGraph, UserError
from data.geometry.poses import xyzquat_to_poses
from sgslam.slam import SceneGraphSlam

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"
SE2 = ROOT.parent / "shared/data/slam_graphs"
SCANS = 220


def run(name: str, *arguments: Path | str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(EXAMPLES / name), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False, timeout=300)


def test_all_examples_are_run_here() -> None:
    imported = {"made_input.py", "walls_in_cloud.py"}
    assert {path.name for path in EXAMPLES.iterdir() if path.suffix == ".py"} - imported == {
        "own_pose_graph.py", "isam2_anchors.py", "kiss_slam_graph.py", "anchor_s_graphs.py", "scan_by_scan.py",
        "ros2_live.py",
    }  # fmt: skip


def errors_told(text: str) -> list[float]:
    """The metres of all lines that tell an error."""
    return [float(metres) for metres in re.findall(r"^error of the .*?([\d.]+) m\b", text, re.MULTILINE)]


@pytest.mark.slow
def test_a_pose_graph_of_ones_own_is_matched_and_anchored() -> None:
    done = run("own_pose_graph.py")
    assert done.returncode == 0, done.stderr
    matched, anchored = errors_told(done.stdout)
    assert done.stdout.startswith("unique: ") and anchored < 0.02 < 0.05 < matched


@pytest.mark.slow
def test_anchors_in_isam2_come_and_the_one_of_a_wall_off_its_plan_goes() -> None:
    done = run("isam2_anchors.py")
    assert done.returncode == 0, done.stderr
    *lines, last = done.stdout.splitlines()
    counts = [(int(line.split()[2]), int(line.split()[4])) for line in lines]
    assert errors_told(last)[0] < 0.02 and last.endswith("not as planned: w5")
    assert sum(gone for _, gone in counts) == 1 and counts[0][0] < counts[-1][0] == 47  # of 48 walls


@pytest.mark.slow
def test_local_maps_of_kiss_slam_are_matched_and_anchored(tmp_path: Path) -> None:
    done = run("kiss_slam_graph.py")
    assert done.returncode == 0, done.stderr
    matched, anchored = errors_told(done.stderr)
    assert anchored < 0.04 < 0.2 < matched
    code = "import pathlib, made_input as m; m.write_local_maps(p := pathlib.Path('.'))[0].save(p / 'plan.json')"
    environment = {**os.environ, "PYTHONPATH": f"{EXAMPLES}:{ROOT}"}
    subprocess.run([sys.executable, "-c", code], cwd=tmp_path, env=environment, check=True)
    given = run("kiss_slam_graph.py", tmp_path, tmp_path / "plan.json")
    assert given.stdout == done.stdout and len(given.stdout.splitlines()) > 5 and "error" not in given.stderr
    plan = SceneGraph.load(tmp_path / "plan.json")
    half = replace(plan, rooms=(), doors=(), wall_surfaces=tuple(replace(w, room=None) for w in plan.wall_surfaces[:4]))
    half.save(tmp_path / "half.json")
    refused = run("kiss_slam_graph.py", tmp_path, tmp_path / "half.json")
    assert refused.returncode == 2 and "no unique place" in refused.stderr and "Traceback" not in refused.stderr


@pytest.mark.slow
def test_a_graph_of_s_graphs_is_matched_and_anchored(tmp_path: Path) -> None:
    drawn = drawn_graph()
    unset = "EDGE_SE3_PLANE 100 200 1 0 0 3.3e-312 10 0 0 10 0 10"
    done = run("anchor_s_graphs.py", *replace(drawn, lines=[*drawn.lines, unset]).write(tmp_path))
    assert done.returncode == 0, done.stderr
    assert "unique: " in done.stderr and "left out, line" in done.stderr
    rows = [line.split() for line in done.stdout.splitlines()]
    assert {int(row[0]) for row in rows} == set(drawn.keyframes)
    for number, *numbers in rows:
        found, true = xyzquat_to_poses([float(x) for x in numbers]), drawn.keyframes[int(number)]
        assert np.linalg.norm((found - true)[:2, 3]) < 0.02
        assert np.abs(found[:3, :3] - true[:3, :3]).max() < 0.01


@pytest.mark.slow
@pytest.mark.skipif(not (SE2 / "SE2_s_graph.g2o").exists(), reason=f"{SE2}/SE2_s_graph.g2o is not there")
def test_the_published_graph_is_matched_and_anchored() -> None:
    done = run("anchor_s_graphs.py", SE2 / "SE2_s_graph.g2o", SE2 / "SE2.json")
    assert done.returncode == 0, done.stderr
    laid, anchored = (float(word) for word in done.stderr.splitlines()[-1].split() if word.isdigit())
    assert anchored < laid and len(done.stdout.splitlines()) == 20


@pytest.mark.slow
def test_a_graph_without_a_place_and_files_that_are_none_are_told_in_a_line(tmp_path: Path) -> None:
    drawn = drawn_graph()
    graph, plan = drawn.write(tmp_path)
    half = replace(drawn.plan, rooms=drawn.plan.rooms[:1], wall_surfaces=drawn.plan.wall_surfaces[:3])
    half.save(tmp_path / "half.json")
    for arguments, told in (
        ((graph, tmp_path / "half.json"), "no unique match"),
        ((plan, plan), "no keyframe"),
    ):
        done = run("anchor_s_graphs.py", *arguments)
        assert done.returncode == 2 and done.stderr.splitlines()[-1].startswith("error: ")
        assert told in done.stderr and "Traceback" not in done.stderr


@pytest.mark.slow
@pytest.mark.skipif(find_spec("rclpy") is not None, reason="there is a ROS here")
def test_where_there_is_no_ros_the_node_says_so() -> None:
    done = run("ros2_live.py")
    assert done.returncode == 2 and "ROS 2 is not there" in done.stderr and len(done.stderr.splitlines()) == 1


@pytest.fixture(scope="module")
def drive() -> Drive:
    return small_drive()


@pytest.mark.slow
def test_scans_are_fed_one_by_one_and_the_graph_is_read_between(drive: Drive, tmp_path: Path) -> None:
    building = write_small_ifc(tmp_path / "small.ifc", site=(3000.0, -2000.0, 40.0), yaw=0.5, elevation=3.0)
    scans = tmp_path / "scans"
    scans.mkdir()
    for k, (_, points) in enumerate(drive.scans[:SCANS]):
        np.save(scans / f"{k:06d}.npy", points)
    (scans / "times.txt").write_text("".join(f"{stamp / 1e9:.3f}\n" for stamp, _ in drive.scans[:SCANS]))
    done = run("scan_by_scan.py", scans, building.path)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert [line.split(":")[0] for line in lines[:-1]] == [f"scan {k}" for k in (0, 50, 100, 150, 200, SCANS - 1)]
    assert lines[-1].startswith("anchored: ")
    x, y = (float(word) for word in lines[-2].partition("; at ")[2].split()[:2])
    np.testing.assert_allclose([x, y], drive.truth.positions[SCANS - 1][:2], atol=0.1)


@pytest.mark.long
@pytest.mark.slow
def test_reading_the_graph_between_scans_changes_nothing(drive: Drive) -> None:
    quiet = fed(SceneGraphSlam(drive.bim), drive.scans[:SCANS])
    curious = SceneGraphSlam(drive.bim)
    with pytest.raises(UserError, match="no scan was added"):
        curious.s_graph()
    for k, (stamp_ns, points) in enumerate(drive.scans[:SCANS]):
        fed(curious, [(stamp_ns, points)])
        if k % 10 == 0:
            curious.s_graph()
    graph = curious.s_graph()
    assert graph.frame == "map" and graph.rooms and graph.wall_surfaces
    assert graph.to_dict() == quiet.s_graph().to_dict()
    T_bim_map, anchors = curious.T_bim_map, curious.anchors
    assert T_bim_map is not None and any(anchor.state == "tight" for anchor in anchors)
    result, other = curious.finish(), quiet.finish()
    assert result.trajectory.poses.tobytes() == other.trajectory.poses.tobytes()
    assert result.T_bim_map is not None and np.linalg.norm((result.T_bim_map - T_bim_map)[:3, 3]) < 0.1


def test_a_map_without_a_building_has_a_graph_too(drive: Drive) -> None:
    slam = fed(SceneGraphSlam(), drive.scans[:60])
    assert slam.s_graph().wall_surfaces and slam.T_bim_map is None and slam.anchors == ()
