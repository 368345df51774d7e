"""A user's script knows every type: mypy in strict mode finds no `Any` in what the public names give."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = '''
from typing import assert_type
import numpy as np
from numpy.typing import NDArray
from data import SceneGraph
from matching import Matcher, MatchResult
from sgslam import Config, KissOdometry, Result, SceneGraphSlam, Update, UserError, __version__, load_bim
import sgslam

bim = load_bim("building.ifc")
assert_type(bim.graph, SceneGraph)
matcher = Matcher.load("voting")
assert_type(matcher, sgslam.Matcher)
config = Config()
assert_type(config.odometry.voxel_size, float)
slam = SceneGraphSlam(bim=bim, matcher=matcher, config=config, odometry=KissOdometry(config.odometry))
points = np.zeros((9, 3), np.float32)
try:
    update = slam.add_scan(0, points, point_times=np.zeros(9), T_odom_sensor=np.eye(4))
except UserError as error:
    assert_type(error, sgslam.UserError)
    raise
assert_type(update, Update)
assert_type((update.stamp_ns, update.keyframes, update.anchored), tuple[int, int, bool])
assert_type(update.T_map_sensor, NDArray[np.float64])

result = slam.finish()
assert_type(result, Result)
assert_type((result.anchored, result.reason, result.keyframes), tuple[bool, str, int])
assert_type(result.trajectory.stamps_ns, NDArray[np.int64])
assert_type(result.trajectory.poses, NDArray[np.float64])
assert_type(result.T_bim_map, NDArray[np.float64] | None)
assert_type((result.s_graph, result.a_graph), tuple[SceneGraph, SceneGraph | None])
assert_type((result.first_anchor_s, result.seconds), tuple[float | None, dict[str, float]])
if result.matches is not None:
    assert_type(result.matches["T_a_s"], list[float] | None)
for deviation in result.deviations:
    if deviation["kind"] == "moved":
        assert_type(deviation["offset_m"], float)
    assert_type((deviation["significant"], deviation["reason"]), tuple[bool, str])
for anchor in result.anchors:
    assert_type((anchor["wall"], anchor["a_id"]), tuple[str, str])
result.save("out")

graph = SceneGraph.load("s_graph.json")
assert_type(graph, sgslam.SceneGraph)
match = matcher.match(graph, bim.graph, floor="F0", start=(0.0, 0.0, 0.0))
assert_type(match, MatchResult)
assert_type(match.rooms, tuple[tuple[str, str, float], ...])
assert_type(match.T_a_s, tuple[float, float, float] | None)
assert_type(match.hypotheses[0].score, float)
assert_type(__version__, str)
'''


def strict(folder: Path, text: str, cache: Path) -> subprocess.CompletedProcess[str]:
    """What mypy says of a script in a folder of its own, with our packages found as installed ones are."""
    (folder / "script.py").write_text(text)
    environment = {k: v for k, v in os.environ.items() if k != "MYPYPATH"} | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "mypy", "--strict", "--config-file=", f"--cache-dir={cache}", "script.py"]
    return subprocess.run(command, capture_output=True, text=True, env=environment, cwd=folder, check=False)


@pytest.mark.long
@pytest.mark.slow
def test_the_examples_know_every_type(tmp_path: Path) -> None:
    examples = sorted(map(str, (ROOT / "examples").glob("*.py")))
    options = ["--strict", "--follow-imports=silent", f"--cache-dir={tmp_path}"]
    command = [sys.executable, "-m", "mypy", *options, *examples]
    done = subprocess.run(command, capture_output=True, text=True, cwd=ROOT, check=False)
    assert examples and done.returncode == 0, done.stdout + done.stderr


@pytest.mark.long
@pytest.mark.slow
def test_a_script_of_a_user_knows_every_type(tmp_path: Path) -> None:
    done = strict(tmp_path, SCRIPT, tmp_path / "cache")
    assert done.returncode == 0, done.stdout + done.stderr
    mistakes = {
        'sgslam.SceneGraphSlam(bim="building.ifc")': "arg-type",
        "sgslam.load_bims": "attr-defined",
        "slam.add_scan(0, [1.0, 2.0])": "arg-type",
        "update.T_plan_sensor": "attr-defined",
        'result.deviations[0]["offset"]': "typeddict-item",
    }
    done = strict(tmp_path, SCRIPT + "\n".join(mistakes), tmp_path / "cache")
    first = SCRIPT.count("\n") + 1
    told = [line for line in done.stdout.splitlines() if ": error: " in line]
    for number, (mistake, code) in enumerate(mistakes.items(), first):
        assert any(line.startswith(f"script.py:{number}:") and line.endswith(f"[{code}]") for line in told), (
            mistake,
            done.stdout,
        )
    assert all(int(line.split(":")[1]) >= first for line in told), done.stdout
