"""The examples as a user calls them."""

import re
import subprocess
import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from drives import fed, small_drive
from g2o_files import drawn_graph
from small_ifc import write_small_ifc

from data import UserError
from data.geometry.poses import xyzquat_to_poses
from sgslam.slam import SceneGraphSlam

pytestmark = pytest.mark.slow
ROOT = Path(__file__).resolve().parents[2]
SE2 = ROOT.parent / "shared/data/slam_graphs"
SCANS = 220


def run(name: str, *arguments: Path | str, code: int = 0) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, str(ROOT / "examples" / name), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False, timeout=300)
    assert done.returncode == code and "Traceback" not in done.stderr, done.stderr
    return done


@pytest.mark.parametrize(
    ("name", "matched_m", "anchored_m"),
    [("own_pose_graph.py", 0.05, 0.02), ("kiss_slam_graph.py", 0.2, 0.04), ("isam2_anchors.py", None, 0.02)],
)
def test_anchors_correct_the_drift_of_a_graph(name: str, matched_m: float | None, anchored_m: float) -> None:
    done = run(name)
    errors = re.findall(r"^error of the .*?([\d.]+) m\b", done.stdout + done.stderr, re.MULTILINE)
    assert float(errors[-1]) < anchored_m
    assert matched_m is None or float(errors[0]) > matched_m


def test_a_graph_of_s_graphs_is_matched_and_anchored(tmp_path: Path) -> None:
    drawn = drawn_graph()
    unset = "EDGE_SE3_PLANE 100 200 1 0 0 3.3e-312 10 0 0 10 0 10"
    graph, plan = replace(drawn, lines=[*drawn.lines, unset]).write(tmp_path)
    done = run("anchor_s_graphs.py", graph, plan)
    assert "left out, line" in done.stderr
    rows = [line.split() for line in done.stdout.splitlines()]
    assert {int(row[0]) for row in rows} == set(drawn.keyframes)
    for number, *numbers in rows:
        found, true = xyzquat_to_poses([float(x) for x in numbers]), drawn.keyframes[int(number)]
        assert np.linalg.norm((found - true)[:2, 3]) < 0.02 and np.abs(found[:3, :3] - true[:3, :3]).max() < 0.01
    half = replace(drawn.plan, rooms=drawn.plan.rooms[:1], wall_surfaces=drawn.plan.wall_surfaces[:3])
    half.save(tmp_path / "half.json")
    for arguments, message in (((graph, tmp_path / "half.json"), "no unique match"), ((plan, plan), "no keyframe")):
        assert message in run("anchor_s_graphs.py", *arguments, code=2).stderr


@pytest.mark.skipif(not (SE2 / "SE2_s_graph.g2o").exists(), reason=f"{SE2}/SE2_s_graph.g2o is not there")
def test_the_published_graph_is_matched_and_anchored() -> None:
    done = run("anchor_s_graphs.py", SE2 / "SE2_s_graph.g2o", SE2 / "SE2.json")
    rigid, anchored = (float(word) for word in done.stderr.splitlines()[-1].split() if word.isdigit())
    assert anchored < rigid and len(done.stdout.splitlines()) == 20


@pytest.mark.skipif(find_spec("rclpy") is not None, reason="there is a ROS here")
def test_the_node_needs_ros() -> None:
    assert "ROS 2" in run("ros2_live.py", code=2).stderr


@pytest.mark.long
def test_scans_are_added_one_by_one_and_reading_the_graph_between_changes_nothing(tmp_path: Path) -> None:
    drive = small_drive()
    building = write_small_ifc(tmp_path / "small.ifc", site=(3000.0, -2000.0, 40.0), yaw=0.5, elevation=3.0)
    (tmp_path / "scans").mkdir()
    for k, (_, points) in enumerate(drive.scans[:SCANS]):
        np.save(tmp_path / f"scans/{k:06d}.npy", points)
    (tmp_path / "scans/times.txt").write_text("".join(f"{stamp / 1e9:.3f}\n" for stamp, _ in drive.scans[:SCANS]))
    *_, there, last = run("scan_by_scan.py", tmp_path / "scans", building.path).stdout.splitlines()
    x, y = (float(word) for word in there.partition("; at ")[2].split()[:2])
    assert last.startswith("anchored: ")
    np.testing.assert_allclose([x, y], drive.truth.positions[SCANS - 1][:2], atol=0.1)
    slam = SceneGraphSlam(drive.bim)
    with pytest.raises(UserError, match="no scan was added"):
        slam.s_graph()
    quiet = fed(SceneGraphSlam(drive.bim), drive.scans[:60])
    for scan in drive.scans[:60]:
        fed(slam, [scan]).s_graph()
    assert slam.s_graph().wall_surfaces and slam.s_graph().to_dict() == quiet.s_graph().to_dict()
