"""A steady drive is good, and a lost sensor is found again where it was."""

from copy import deepcopy
from typing import Any

import numpy as np
import pytest
from boxes import pose, room, scan, scene_of
from walks import FURNISHED, SCAN_NS, furnished, straight, ways_off

from sgslam.config import TrackingSettings
from sgslam.odometry.continuous_time import ContinuousTimeOdometry
from sgslam.registration import Registration


@pytest.fixture(scope="module")
def driven() -> tuple[list[Registration], dict[str, Any]]:
    """The first results and the state of an odometry that is lost after a steady drive."""
    odometry, poses = ContinuousTimeOdometry(TrackingSettings()), straight(25)
    found = [odometry.register(SCAN_NS * k, scan(furnished(), T, seed=k)) for k, T in enumerate(poses)]
    assert {result.health for result in found} == {"good"}
    assert ways_off(found, poses).max() < 0.02  # m; measured 0.005 at the end
    odometry.level(np.array([0.0, 0.0, 1.0]))
    covered = np.random.default_rng(0).uniform(0.4, 0.8, (2000, 3))
    assert odometry.register(25 * SCAN_NS, covered).health == "lost"
    return found, odometry.state()


@pytest.mark.parametrize(("x", "y", "yaw", "near"), [(2.5, 2.9, -1.2, True), (3.3, 1.6, -1.2, True), (12, 2, 0, False)])
def test_a_lost_sensor_is_found_again_near_by_but_not_in_another_room(
    driven: tuple[list[Registration], dict[str, Any]], x: float, y: float, yaw: float, near: bool
) -> None:
    lost, other = ContinuousTimeOdometry(TrackingSettings()), ContinuousTimeOdometry(TrackingSettings())
    lost.restore(deepcopy(driven[1]))
    scene = scene_of([*FURNISHED, *room(11, 0, 14, 9), (12, 5, 0, 13, 6, 1.2)])
    after = [pose(x + 0.03 * k, y, 0.9, yaw + 0.02 * k, 0.1, 0.1) for k in range(8)]
    scans = [scan(scene, T, seed=50 + k) for k, T in enumerate(after)]
    for k, points in enumerate(scans[:7], 25):
        other.register(k * SCAN_NS, points)
    assert lost.rejoin(other) is near
    found = lost.register(32 * SCAN_NS, scans[7])
    assert (found.health == "good") is near
    assert not near or ways_off([driven[0][0], found], [straight(1)[0], after[7]])[1] < 0.05  # m; measured 0.01
