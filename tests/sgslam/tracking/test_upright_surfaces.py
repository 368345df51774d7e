"""Walls, floors and ceilings are found where the tracked attitude has tilted, and right its vertical."""

import numpy as np
import pytest
from boxes import Array, pose, room, scan, scene_of

from data.simulation.sensors import sensor_named
from sgslam.config import Config
from sgslam.geometry.frames import transform_planes, transform_points
from sgslam.tracking.front_end import FrontEnd, KeyframeScan, level_to_sensor
from sgslam.tracking.gravity import refined_up

UP = np.array([0.0, 0.0, 1.0])
ROOM = scene_of([*room(0, 0, 7, 5), (3.0, 2.0, 0.0, 3.5, 2.5, 1.0)])
ON_THE_WAY = [pose(2.0 + 0.2 * k, 1.5, 1.2, yaw=0.1 * k, pitch=0.02 * k) for k in range(6)]


def seen(roll: float) -> KeyframeScan:
    """From the last of some poses on the way, tracked as if the room were rolled by an angle (rad)."""
    front_end, T_odom_room = FrontEnd(Config()), pose(0.0, 0.0, 0.0, roll=roll)
    scans = [scan(ROOM, T, seed=k) for k, T in enumerate(ON_THE_WAY)]
    for points, T in zip(scans, ON_THE_WAY, strict=True):
        front_end.add(points, T_odom_room @ T)
    T_odom_sensor = T_odom_room @ ON_THE_WAY[-1]
    return front_end.look(scans[-1], T_odom_sensor, level_to_sensor(T_odom_sensor, UP), 1.2)


def angle_deg(a: Array, b: Array) -> float:
    return float(np.degrees(np.arccos(np.clip(a @ b, -1.0, 1.0))))


@pytest.mark.parametrize("roll_deg", [0.0, 3.0, -8.0])
def test_surfaces_are_found_though_the_tracked_attitude_tilts(roll_deg: float) -> None:
    found, T = seen(np.radians(roll_deg)), ON_THE_WAY[-1]
    assert angle_deg(T[:3, :3] @ found.up, UP) < 0.5 + 0.05 * abs(roll_deg)
    assert found.sigma_up < np.radians(1.5)
    walls = transform_planes(T, np.stack([plane for _, plane, _ in found.walls]))
    assert len(walls) >= 4
    assert np.abs(walls[:, 2]).max() < np.radians(2.0)  # upright in the room, not in `odom`
    floors = [transform_planes(T, level.plane) for level in found.levels if level.is_floor]
    assert floors and min(abs(floor[3]) for floor in floors) < 0.03
    assert max(angle_deg(floor[:3], UP) for floor in floors) < 1.5


def test_where_no_surface_is_upright_or_level_the_tracked_attitude_stays() -> None:
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(400, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    assert refined_up(UP, normals, np.ones(400)) is None
    assert refined_up(UP, np.eye(3).repeat(9, axis=0), np.ones(27)) is None  # few
    assert refined_up(UP, np.eye(3).repeat(10, axis=0), np.ones(30)) is not None


def test_a_keyframe_without_scans_before_it_tells_no_vertical() -> None:
    front_end, T = FrontEnd(Config()), ON_THE_WAY[0]
    found = front_end.look(scan(ROOM, T), T, level_to_sensor(T, UP), 1.2)
    assert found.sigma_up == np.inf and len(found.walls) >= 4 and not found.levels


def test_a_ceiling_shows_no_lintels_though_its_points_are_noisy() -> None:
    """Two low rooms, and a door between them under a lintel, at x = 4."""
    wall = [(4.0, 0.0, 0.0, 4.2, 1.0, 2.3), (4.0, 2.0, 0.0, 4.2, 4.0, 2.3), (4.0, 1.0, 2.05, 4.2, 2.0, 2.3)]
    rooms, sensor = scene_of([*room(0, 0, 8, 4, height=2.3), *wall]), sensor_named("OS0-32", None)
    front_end, T = FrontEnd(Config()), pose(2.0, 1.7, 1.6)
    rng = np.random.default_rng(0)
    for _ in range(6):
        points = scan(rooms, T, sensor)
        points *= 1 + rng.normal(0, 0.03, len(points))[:, None] / np.linalg.norm(points, axis=1)[:, None]
        front_end.add(points, T)
    found = transform_points(T, front_end.look(points, T, level_to_sensor(T, UP), 1.6).lintels.astype(float))
    x, y = found[:, 0], found[:, 1]
    over_door = (np.abs(x - 4.0) < 0.2) & (y > 1.0) & (y < 2.0)
    at_walls = np.min(np.abs([x, x - 4.0, x - 8.0, y, y - 4.0]), axis=0) < 0.2
    assert over_door.sum() > 5 and at_walls.mean() > 0.98
