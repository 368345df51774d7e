"""A run that was broken off goes on as if it had not been."""

from pathlib import Path

import numpy as np
import pytest
from drives import fed, small_drive

from data.errors import UserError
from sgslam.checkpoints import Checkpoints, load
from sgslam.result import Result
from sgslam.slam import SceneGraphSlam


@pytest.fixture(scope="module")
def whole() -> Result:
    drive = small_drive()
    return fed(SceneGraphSlam(drive.bim), drive.scans).finish()


@pytest.mark.parametrize("after", [1, 7, 60, -1])
def test_a_run_goes_on_bit_by_bit(after: int, whole: Result, tmp_path: Path) -> None:
    drive = small_drive()
    first = fed(SceneGraphSlam(drive.bim), drive.scans[:after])
    assert Checkpoints(tmp_path, {}).write(first, {"fed": after})
    second = SceneGraphSlam(drive.bim, clouds=first.clouds)
    assert load(tmp_path, second) == {"fed": after}
    result = fed(second, drive.scans[after:]).finish()
    assert np.array_equal(result.trajectory.poses, whole.trajectory.poses)
    assert np.array_equal(result.trajectory_odometry.poses, whole.trajectory_odometry.poses)
    assert result.s_graph == whole.s_graph and result.deviations == whole.deviations
    assert result.anchors == whole.anchors and result.factors.events == whole.factors.events
    assert result.matches is not None and whole.matches is not None
    assert {**result.matches, "seconds": 0} == {**whole.matches, "seconds": 0}


def test_a_state_of_an_unlike_run_is_refused(tmp_path: Path) -> None:
    drive = small_drive()
    Checkpoints(tmp_path, {}).write(fed(SceneGraphSlam(), drive.scans[:20]), {})
    with pytest.raises(UserError, match="unlike"):
        load(tmp_path, SceneGraphSlam(drive.bim))
    with pytest.raises(UserError, match="holds no run"):
        load(tmp_path / "elsewhere", SceneGraphSlam())
