"""The vertical from surfaces: under any mount, in a building of boxes; None where it cannot be told."""

import functools
import time

import numpy as np
import pytest
from boxes import Array, Box, pose, room, scene_of
from scipy.spatial.transform import Rotation
from surfel_walks import Surfels, rings, surfels_seen, swaying, tilted

from data.geometry.raycast import TriangleScene
from sgslam.tracking.gravity import Gravity, estimate_gravity

EXPECTED = np.array([0.0, 0.0, 1.0])
SENSORS = {"16 rings": rings(-15, 15, 16, 300), "32 rings": rings(-45, 45, 32, 150), "dome": rings(-7, 52, 40, 150)}
HANGING = np.diag([1.0, -1.0, -1.0])
LYING = Rotation.from_euler("y", 90, degrees=True).as_matrix()  # z forward
TABLES: list[Box] = [(1.0, 4.5, 0.7, 2.4, 5.6, 0.75), (6.0, 0.4, 0.7, 7.6, 1.3, 0.75), (8.2, 4.4, 0.4, 9.6, 5.4, 0.45)]


@functools.cache
def two_rooms() -> TriangleScene:
    """10 m by 6 m and 2.6 m high, a wall in it with a door, and tables."""
    wall: list[Box] = [(4.9, 0, 0, 5.0, 2.5, 2.6), (4.9, 3.4, 0, 5.0, 6, 2.6), (4.9, 2.5, 2.1, 5.0, 3.4, 2.6)]
    return scene_of([*room(0, 0, 10, 6), *wall, *TABLES])


def through_the_door() -> Array:
    """(50, 4, 4) level poses."""
    x = np.linspace(2.0, 7.0, 50)
    y = 2.95 + 0.8 * np.sin((x - 4.95) / 1.5)
    return np.stack([pose(*at, 1.3, yaw=np.arctan2(*np.gradient([y, x], axis=1)[:, k])) for k, at in enumerate(zip(x, y, strict=True))])


def seen(mount: Array, sensor: str, seed: int, voxel: float = 0.25) -> Surfels:
    """What is seen on the way through the door."""
    rng = np.random.default_rng(seed)
    return surfels_seen(two_rooms(), swaying(through_the_door(), mount, rng), SENSORS[sensor], rng, voxel)


def estimated(s: Surfels, expected: Array = EXPECTED) -> Gravity | None:
    """With the surfels' own weights."""
    return estimate_gravity(s.positions, s.normals, s.weights, s.sensor_positions, expected)


def error_deg(found: Gravity, s: Surfels) -> float:
    """Between the vertical found and the true one."""
    return float(np.degrees(np.arccos(np.clip(found.up_in_odom @ s.up, -1.0, 1.0))))


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("degrees", [0.0, 12.0, 25.0, 40.0])
def test_a_tilted_mount_needs_no_flag(sensor: str, degrees: float) -> None:
    scenes = [seen(tilted(degrees, np.random.default_rng(seed)), sensor, seed) for seed in range(3)]
    found = [(s, estimated(s)) for s in scenes]
    errors = [error_deg(g, s) for s, g in found if g is not None]
    assert len(errors) >= 2
    assert max(errors) < 1.5
    assert all(np.radians(error_deg(g, s)) < 4 * g.sigma for s, g in found if g is not None)
