"""What is known of how the sensor stands when the first seconds are over."""

import logging

import numpy as np
import pytest
from boxes import pose, scan
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from test_gravity import HANGING, two_rooms

from sgslam.config import TrackingSettings
from sgslam.odometry.continuous_time import ContinuousTimeOdometry
from sgslam.tracking.level_frame import LevelFrame

Degrees = tuple[float, float, float]


def told(hangs: bool, mount: Degrees | None, caplog: pytest.LogCaptureFixture) -> str:
    """The last line about a sensor that stands, or hangs, still in one of two rooms for six seconds."""
    return lines(HANGING if hangs else np.eye(3), mount, caplog)[-1]


def lines(turned: NDArray[np.float64], mount: Degrees | None, caplog: pytest.LogCaptureFixture) -> list[str]:
    """Those about a sensor that is `turned` so, R_upright_sensor (3, 3)."""
    settings = TrackingSettings(mount=mount)
    frame, odometry, results = LevelFrame(settings, 0.1), ContinuousTimeOdometry(settings), []
    for k in range(13):
        points = scan(two_rooms(), pose(2.5, 2.0, 1.3), seed=k) @ turned
        results.append(odometry.register(k * 500_000_000, points, None))
        frame.add(k * 500_000_000, points, results)
    with caplog.at_level(logging.INFO):
        frame.settle(results)
    return caplog.messages


@pytest.mark.parametrize("hangs", [False, True])
def test_a_mount_that_is_not_stated_is_taken_for_upright(hangs: bool, caplog: pytest.LogCaptureFixture) -> None:
    assert "begins 0 degrees off upright" in told(hangs, None, caplog)
    assert LevelFrame(TrackingSettings(), 0.1).is_way_up_assumed
    assert not LevelFrame(TrackingSettings(mount=(180.0, 0.0, 0.0)), 0.1).is_way_up_assumed


@pytest.mark.parametrize(("pitch", "warned"), [(12.0, False), (90.0, True)])
def test_a_sensor_on_its_side_is_never_sure_of_up_without_its_mount(
    pitch: float, warned: bool, caplog: pytest.LogCaptureFixture
) -> None:
    turned = Rotation.from_euler("y", pitch, degrees=True).as_matrix()
    assert any("not certain" in line for line in lines(turned, None, caplog)) == warned
    caplog.clear()
    assert not any("not certain" in line for line in lines(turned, (0.0, pitch, 0.0), caplog))


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
    assert not frame.is_way_up_assumed
    assert "--mount" not in caplog.text
