"""The examples as a user calls them."""

import re
import subprocess
import sys
from dataclasses import replace
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
    assert "left out, EDGE_SE3_PLANE of 100 and 200" in done.stderr
    rows = [line.split() for line in done.stdout.splitlines()]
    assert {int(row[0]) for row in rows} == set(drawn.keyframes)
    for number, *numbers in rows:
        found, true = xyzquat_to_poses([float(x) for x in numbers]), drawn.keyframes[int(number)]
        assert np.linalg.norm((found - true)[:2, 3]) < 0.02 and np.abs(found[:3, :3] - true[:3, :3]).max() < 0.01
    assert "no keyframe" in run("anchor_s_graphs.py", plan, plan, code=2).stderr


@pytest.mark.long
def test_scans_are_added_one_by_one_and_reading_the_graph_between_changes_nothing(tmp_path: Path) -> None:
    drive = small_drive()
    building = write_small_ifc(tmp_path / "small.ifc", site=(3000.0, -2000.0, 40.0), yaw=0.5, elevation=3.0)
    (tmp_path / "scans").mkdir()
    for k, (_, points) in enumerate(drive.scans[:220]):
        np.save(tmp_path / f"scans/{k:06d}.npy", points)
    assert "anchored: " in run("scan_by_scan.py", tmp_path / "scans", building.path).stdout.splitlines()[-1]
    slam, quiet = SceneGraphSlam(drive.bim), fed(SceneGraphSlam(drive.bim), drive.scans[:60])
    with pytest.raises(UserError, match="no scan was added"):
        slam.s_graph()
    for scan in drive.scans[:60]:
        fed(slam, [scan]).s_graph()
    assert slam.s_graph().wall_surfaces and slam.s_graph().to_dict() == quiet.s_graph().to_dict()
