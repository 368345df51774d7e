"""A user's script knows every type: mypy in strict mode finds no `Any` in what the public names give."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = [pytest.mark.long, pytest.mark.slow]
ROOT = Path(__file__).resolve().parents[2]
SCRIPT = """
from typing import assert_type
import numpy as np
from numpy.typing import NDArray
from data import SceneGraph
from matching import Matcher, MatchResult
from sgslam import Config, KissOdometry, Result, SceneGraphSlam, Update, __version__, load_bim
import sgslam

bim = load_bim("building.ifc")
assert_type(bim.graph, SceneGraph)
matcher = Matcher.load("voting")
config = Config()
slam = SceneGraphSlam(bim=bim, matcher=matcher, config=config, odometry=KissOdometry(config.odometry))
points = np.zeros((9, 3), np.float32)
update = slam.add_scan(0, points, point_times=np.zeros(9), T_odom_sensor=np.eye(4))
assert_type(update, Update)
assert_type((update.stamp_ns, update.keyframes, update.anchored), tuple[int, int, bool])
assert_type(update.T_map_sensor, NDArray[np.float64])

result = slam.finish()
assert_type(result, Result)
assert_type((result.anchored, result.reason, result.keyframes), tuple[bool, str, int])
assert_type(result.trajectory.poses, NDArray[np.float64])
assert_type(result.T_bim_map, NDArray[np.float64] | None)
for deviation in result.deviations:
    if deviation["kind"] == "moved":
        assert_type(deviation["offset_m"], float)
for anchor in result.anchors:
    assert_type((anchor["wall"], anchor["a_id"]), tuple[str, str])
result.save("out")

match = matcher.match(SceneGraph.load("s_graph.json"), bim.graph, floor="F0", start=(0.0, 0.0, 0.0))
assert_type(match, MatchResult)
assert_type(match.rooms, tuple[tuple[str, str, float], ...])
assert_type(match.T_a_s, tuple[float, float, float] | None)
assert_type(__version__, str)
"""
MISTAKES = {
    'sgslam.SceneGraphSlam(bim="building.ifc")': "arg-type",
    "sgslam.load_bims": "attr-defined",
    "slam.add_scan(0, [1.0, 2.0])": "arg-type",
    "update.T_plan_sensor": "attr-defined",
    'result.deviations[0]["offset"]': "typeddict-item",
}


def mypy(*arguments: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    environment = {k: v for k, v in os.environ.items() if k != "MYPYPATH"} | {"PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "mypy", "--strict", *arguments]
    return subprocess.run(command, capture_output=True, text=True, env=environment, cwd=cwd, check=False)


def test_examples_know_every_type(tmp_path: Path) -> None:
    examples = sorted(map(str, (ROOT / "examples").glob("*.py")))
    done = mypy("--follow-imports=silent", f"--cache-dir={tmp_path}", *examples, cwd=ROOT)
    assert examples and done.returncode == 0, done.stdout + done.stderr


def test_a_script_of_a_user_knows_every_type_and_its_mistakes_are_found(tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(SCRIPT + "\n".join(MISTAKES))
    done = mypy("--config-file=", f"--cache-dir={tmp_path / 'cache'}", "script.py", cwd=tmp_path)
    first = SCRIPT.count("\n") + 1
    expected = {(number, code) for number, code in enumerate(MISTAKES.values(), first)}
    errors = [line for line in done.stdout.splitlines() if ": error: " in line]
    assert {(int(line.split(":")[1]), line.rsplit("[", 1)[1].rstrip("]")) for line in errors} == expected, done.stdout
