"""Where up is when the first seconds are over, and what the surroundings of half a minute say of that."""

import logging

import numpy as np
import pytest
from boxes import Array, pose, scan
from scipy.spatial.transform import Rotation
from walks import two_rooms

from data.simulation import SpinningSensor
from sgslam.config import TrackingSettings
from sgslam.odometry.continuous_time import ContinuousTimeOdometry
from sgslam.tracking.level_check import LevelCheck
from sgslam.tracking.level_frame import LevelFrame

Degrees = tuple[float, float, float]
NS = 1_000_000_000
WIDE = SpinningSensor(beams=32, lowest_deg=-45, highest_deg=45)


def turn(roll: float = 0.0, pitch: float = 0.0) -> Array:
    return Rotation.from_euler("ZYX", [0.0, pitch, roll], degrees=True).as_matrix()


def settled(R_upright_sensor: Array, mount: Degrees | None, measured: Array | None = None) -> LevelFrame:
    """After six seconds in which the sensor stands, or hangs, still in one of two rooms."""
    settings = TrackingSettings(mount=mount)
    frame, odometry, results = LevelFrame(settings, 0.1), ContinuousTimeOdometry(settings), []
    for k in range(13):
        points = scan(two_rooms(), pose(2.5, 2.0, 1.3), seed=k) @ R_upright_sensor
        results.append(odometry.register(k * NS // 2, points, None))
        frame.measure(measured)
        frame.add(k * NS // 2, points, results)
    frame.settle(results)
    return frame


@pytest.mark.parametrize(
    ("roll", "pitch", "mount", "warned", "right"),
    [
        (0.0, 0.0, None, False, True),
        (0.0, 12.0, None, False, True),
        (0.0, 90.0, None, True, None),  # which end is up is never sure
        (0.0, 90.0, (0.0, 90.0, 0.0), False, True),
        (180.0, 0.0, None, False, False),  # a mount that is not stated is taken for upright
        (180.0, 0.0, (180.0, 0.0, 0.0), False, True),
        (0.0, 0.0, (0.0, 40.0, 0.0), True, True),  # the wrong mount is stated
    ],
)
def test_up_is_found_or_the_mount_is_asked_for(
    roll: float,
    pitch: float,
    mount: Degrees | None,
    warned: bool,
    right: bool | None,
    caplog: pytest.LogCaptureFixture,
) -> None:
    R = turn(roll, pitch)
    frame = settled(R, mount)
    assert any("--mount" in record.message for record in caplog.records) == warned
    assert (frame.advice is not None) == (warned and mount is not None)
    assert frame.is_way_up_assumed == (mount is None)
    assert right is None or (frame.likely_up @ R[2] > np.cos(np.radians(1.0))) == right


def test_what_an_accelerometer_shows_counts_for_the_sign(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO):
        frame = settled(turn(roll=180.0), None, np.array([0.05, 0.0, -1.0]) / np.hypot(0.05, 1.0))
    assert frame.sure and frame.likely_up[2] < -0.9995  # the axis is that of the surfaces
    assert not frame.is_way_up_assumed and "--mount" not in caplog.text


@pytest.mark.parametrize(
    ("roll", "seconds", "said"),
    [(0.0, 31, None), (4.0, 31, None), (40.0, 29, None), (40.0, 31, "40 degrees off"), (180.0, 31, None)],
)
def test_a_level_frame_that_the_surroundings_contradict_is_reported_after_half_a_minute(
    roll: float, seconds: int, said: str | None, caplog: pytest.LogCaptureFixture
) -> None:
    """On a walk through a door and back, on which the state is saved and restored."""
    check, T = LevelCheck(TrackingSettings()), np.eye(4)
    T[:3, :3] = turn(roll)
    for k in range(seconds + 1):
        if k == 16:
            state, check = check.state(), LevelCheck(TrackingSettings())
            check.restore(state)
        T_scene_sensor = pose(4.5 + 2.5 * np.sin(k / 5), 2.95, 1.3, yaw=k / 10)
        check.add(k * NS, scan(two_rooms(), T_scene_sensor, WIDE, seed=k), T @ T_scene_sensor)
    assert len(caplog.messages) == (said is not None)
    assert all(str(said) in message and "--mount" in message for message in caplog.messages)
