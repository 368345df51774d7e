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
from sgslam import Config, KissOdometry, Result, SceneGraphSlam, Update, load_bim
import sgslam

bim, matcher, config = load_bim("building.ifc"), Matcher.load("voting"), Config()
slam = SceneGraphSlam(bim=bim, matcher=matcher, config=config, odometry=KissOdometry(config.odometry, config.tracking))
update = slam.add_scan(0, np.zeros((9, 3), np.float32), point_times=np.zeros(9), T_odom_sensor=np.eye(4))
assert_type(update, Update)
assert_type(update.T_map_sensor, NDArray[np.float64])
result = slam.finish()
assert_type(result, Result)
assert_type(result.T_bim_map, NDArray[np.float64] | None)
for deviation in result.deviations:
    if deviation["kind"] == "moved":
        assert_type(deviation["offset_m"], float | None)
match = matcher.match(SceneGraph.load("s_graph.json"), bim.graph, floor="F0", start=(0.0, 0.0, 0.0))
assert_type(match, MatchResult)
assert_type(match.rooms, tuple[tuple[str, str, float], ...])
"""


def test_a_script_of_a_user_knows_every_type(tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(SCRIPT)
    command = [sys.executable, "-m", "mypy", "--strict", "--config-file=", "--cache-dir=cache", "script.py"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=tmp_path, check=False)
    assert done.returncode == 0, done.stdout
