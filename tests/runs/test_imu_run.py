"""An IMU given to a run by library: what is refused, and that its state is saved."""

import numpy as np
import pytest
from boxes import pose, room, scan, scene_of

from data.common.errors import UserError
from sgslam import SceneGraphSlam

UP = np.array([0.0, 0.0, 9.8])
STILL = np.zeros(3)


def test_samples_that_go_back_or_are_not_finite_are_refused() -> None:
    slam = SceneGraphSlam()
    slam.add_imu(5, STILL, UP)
    for stamp, gyro, accel in ((5, STILL, UP), (6, STILL * np.nan, UP), (6, np.zeros(2), UP)):
        with pytest.raises(UserError, match="IMU"):
            slam.add_imu(stamp, gyro, accel)
    slam.add_imu(6, STILL, UP)
    assert slam.newest_imu_ns == 6


def test_a_restored_run_has_the_samples() -> None:
    slam, other = SceneGraphSlam(), SceneGraphSlam()
    stamps = np.arange(0, 10**8, 5_000_000)
    slam.add_imu(stamps, np.zeros((len(stamps), 3)), np.tile(UP, (len(stamps), 1)))
    slam.add_scan(0, scan(scene_of(room(-3.0, -2.0, 5.0, 3.0)), pose(0.0, 0.0, 1.3)))
    other.restore(slam.state())
    assert other.newest_imu_ns == stamps[-1]
