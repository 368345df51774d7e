"""What is known of how the sensor stands when the first seconds are over."""

import logging

import numpy as np
import pytest
from boxes import pose, scan
from test_gravity import HANGING, two_rooms

from sgslam.config import TrackingSettings
from sgslam.odometry.continuous_time import ContinuousTimeOdometry
from sgslam.tracking.level_frame import LevelFrame


def told(hangs: bool, mount: tuple[float, float, float] | None, caplog: pytest.LogCaptureFixture) -> str:
    """The line about a sensor that stands, or hangs, still in one of two rooms for six seconds."""
    settings = TrackingSettings(mount=mount)
    frame, odometry, results = LevelFrame(settings, 0.1), ContinuousTimeOdometry(settings), []
    turned = HANGING if hangs else np.eye(3)
    for k in range(13):
        points = scan(two_rooms(), pose(2.5, 2.0, 1.3), seed=k) @ turned
        results.append(odometry.register(k * 500_000_000, points, None))
        frame.add(k * 500_000_000, points, results)
    with caplog.at_level(logging.INFO):
        frame.settle(results)
    return caplog.messages[-1]


@pytest.mark.parametrize("hangs", [False, True])
def test_a_mount_that_is_not_stated_may_be_upside_down_and_that_is_told(
    hangs: bool, caplog: pytest.LogCaptureFixture
) -> None:
    line = told(hangs, None, caplog)
    assert "begins 0 degrees off upright" in line
    assert "--mount 180,0,0" in line


def test_a_stated_mount_is_not_asked_for_again(caplog: pytest.LogCaptureFixture) -> None:
    assert told(True, (180.0, 0.0, 0.0), caplog).startswith("the sensor begins 0 degrees off its stated mount")


def test_what_an_accelerometer_shows_counts_for_the_sign(caplog: pytest.LogCaptureFixture) -> None:
    settings = TrackingSettings()
    frame, odometry, results = LevelFrame(settings, 0.1), ContinuousTimeOdometry(settings), []
    for k in range(10):
        points = scan(two_rooms(), pose(2.5, 2.0, 1.3), seed=k) @ HANGING
        results.append(odometry.register(k * 500_000_000, points, None))
        frame.measure(np.array([0.05, 0.0, -1.0]) / np.hypot(0.05, 1.0))
        frame.add(k * 500_000_000, points, results)
    assert frame.sure
    with caplog.at_level(logging.INFO):
        frame.settle(results)
    assert frame.likely_up[2] < -0.99
    assert "--mount" not in caplog.text
