"""A level frame that the surroundings contradict is reported after half a minute."""

import logging

import numpy as np
import pytest
from boxes import pose, scan
from scipy.spatial.transform import Rotation
from test_gravity import HANGING, two_rooms

from data.simulation import SpinningSensor
from sgslam.config import TrackingSettings
from sgslam.tracking.level_check import LevelCheck

SENSOR = SpinningSensor(beams=32, lowest_deg=-45, highest_deg=45)
TURNS = {
    "level": np.eye(3), "a few degrees": Rotation.from_euler("x", 4, degrees=True).as_matrix(),
    "tilted": Rotation.from_euler("x", 40, degrees=True).as_matrix(), "upside down": HANGING,
}  # fmt: skip


def warned(turn: str, seconds: float, caplog: pytest.LogCaptureFixture, settings: TrackingSettings) -> list[str]:
    """What is said of a walk through a door and back, if the frame is turned."""
    check, T = LevelCheck(settings), np.eye(4)
    T[:3, :3] = TURNS[turn]
    with caplog.at_level(logging.WARNING):
        for k in range(int(seconds) + 1):
            T_scene_sensor = pose(4.5 + 2.5 * np.sin(k / 5), 2.95, 1.3, yaw=k / 10)
            check.add(k * 10**9, scan(two_rooms(), T_scene_sensor, SENSOR, seed=k), T @ T_scene_sensor)
    return caplog.messages


@pytest.mark.parametrize(
    ("turn", "said"),
    [("level", ""), ("a few degrees", ""), ("tilted", "40 degrees off"), ("upside down", "")],
)
def test_what_is_told(turn: str, said: str, caplog: pytest.LogCaptureFixture) -> None:
    told = warned(turn, 31, caplog, TrackingSettings())
    assert len(told) == (1 if said else 0)
    assert all(said in message and "--mount" in message for message in told)


def test_nothing_is_said_before_half_a_minute(caplog: pytest.LogCaptureFixture) -> None:
    assert not warned("tilted", 29, caplog, TrackingSettings())


def test_one_that_is_restored_goes_on_alike(caplog: pytest.LogCaptureFixture) -> None:
    scenes = [(k, pose(4.5 + 2.5 * np.sin(k / 5), 2.95, 1.3, yaw=k / 10)) for k in range(32)]
    T = np.eye(4)
    T[:3, :3] = TURNS["tilted"]
    first, second = LevelCheck(TrackingSettings()), LevelCheck(TrackingSettings())
    for k, T_scene_sensor in scenes:
        if k == 16:
            second.restore(first.state())
        check = first if k < 16 else second
        check.add(k * 10**9, scan(two_rooms(), T_scene_sensor, SENSOR, seed=k), T @ T_scene_sensor)
    assert len(caplog.messages) == 1
