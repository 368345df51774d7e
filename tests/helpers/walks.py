"""Rooms, walks through them, and what a sensor sees on the way."""

import functools
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from boxes import Array, Box, pose, room, scan, scene_of
from scipy.spatial.transform import Rotation

from data.geometry.raycast import TriangleScene
from data.simulation import Sensor
from sgslam.config import Config
from sgslam.geometry.frames import inverse
from sgslam.serialization import pack, unpack
from sgslam.surfels import SurfelMap
from sgslam.types import Registration

SCAN_NS = 100_000_000
HERE = np.eye(4)
SENSOR = Sensor(azimuths=360)
FURNISHED: list[Box] = [*room(0, 0, 8, 5), (4.5, 3.2, 0, 5.1, 5, 2.6), (0, 0, 0, 1.2, 0.6, 1.8), (7, 1.5, 0, 8, 2, 2.6)]
WITH_DOOR: list[Box] = [(4.9, 0, 0, 5.0, 2.5, 2.6), (4.9, 3.4, 0, 5.0, 6, 2.6), (4.9, 2.5, 2.1, 5.0, 3.4, 2.6)]
TABLES: list[Box] = [(1.0, 4.5, 0.7, 2.4, 5.6, 0.75), (6.0, 0.4, 0.7, 7.6, 1.3, 0.75), (8.2, 4.4, 0.4, 9.6, 5.4, 0.45)]
CORRIDOR: list[Box] = [(-70, -1.2, -0.1, 70, 1.2, 0), (-70, -1.4, 0, 70, -1.2, 2.6), (-70, 1.2, 0, 70, 1.4, 2.6)]


@functools.cache
def furnished() -> TriangleScene:
    return scene_of(FURNISHED)


@functools.cache
def two_rooms() -> TriangleScene:
    """10 m by 6 m and 2.6 m high, a wall in it with a door, and tables."""
    return scene_of([*room(0, 0, 10, 6), *WITH_DOOR, *TABLES])


def through_the_door() -> Array:
    """(50, 4, 4) level poses from one of the two rooms into the other."""
    x = np.linspace(2.0, 7.0, 50)
    y = 2.95 + 0.8 * np.sin((x - 4.95) / 1.5)
    yaw = np.arctan2(np.gradient(y), np.gradient(x))
    return np.stack([pose(a, b, 1.3, yaw=c) for a, b, c in zip(x, y, yaw, strict=True)])


def straight(count: int, turn: float = 0.02) -> list[Array]:
    """Poses in the furnished room, 5 cm and `turn` (rad) from scan to scan."""
    return [pose(1.5 + 0.05 * k, 2.0 + 0.01 * k, 0.8, turn * k) for k in range(count)]


@functools.cache
def bow(seed: int = 0) -> tuple[list[Array], list[Array]]:
    """Scans (N, 3) of the furnished room, and where they are taken: from rest on, 8 cm and 2 degrees a scan."""
    poses, x, y, yaw = [], 1.5, 1.2, 0.3
    for i in range(24):
        poses.append(pose(x, y, 0.8, yaw))
        step = 0.08 * min(1.0, i / 5)
        x, y, yaw = x + step * np.cos(yaw), y + step * np.sin(yaw), yaw + 0.4 * step
    return [scan(furnished(), T, SENSOR, 100 * seed + i) for i, T in enumerate(poses)], poses


def surfels_of(
    scene: TriangleScene, poses: Iterable[Array], sensor: Sensor | None = None, T: Array = HERE, seed: int = 0
) -> SurfelMap:
    """What scans at poses show, in the frame to which T (4, 4) leads from the scene's."""
    surfels = SurfelMap()
    for k, T_scene_sensor in enumerate(poses, seed):
        surfels.add_scan(scan(scene, T_scene_sensor, sensor, k), T @ T_scene_sensor)
    return surfels


def swept(
    scene: TriangleScene,
    moved: Callable[[Array], Array],
    begin: float,
    sensor: Sensor | None = None,
    columns: int = 20,
) -> tuple[Array, Array]:
    """A scan (N, 3) of 0.1 s whose sectors are measured one after another, and the points' times (N,) after `begin`;
    `moved` gives T_scene_sensor at seconds."""
    times = (np.arange(columns) + 0.5) / columns * 0.1
    parts = []
    for k, T in enumerate(moved(begin + times)):
        whole = scan(scene, T, sensor, seed=k)
        azimuth = np.arctan2(whole[:, 1], whole[:, 0]) % (2 * np.pi)
        parts.append(whole[(azimuth * columns / (2 * np.pi)).astype(int) == k])
    return np.concatenate(parts), np.repeat(times, [len(part) for part in parts])


def circle(seconds: Array) -> Array:
    """Poses of a sensor that moves by 10 cm and turns by 6 degrees in each scan."""
    angle = np.radians(60.0 * seconds)
    return np.stack([pose(3 + 0.955 * np.sin(a), 2 - 0.955 * np.cos(a), 0.8, a) for a in angle])


@functools.cache
def rolling() -> list[tuple[Array, Array]]:
    """Scans on the circle, and their points' times."""
    return [swept(furnished(), circle, 0.1 * i, SENSOR, 36) for i in range(24)]


def off(T_a: Array, T_b: Array) -> tuple[float, float]:
    """Metres and radians between two motions."""
    between = inverse(T_a) @ T_b
    return float(np.linalg.norm(between[:3, 3])), float(Rotation.from_matrix(between[:3, :3]).magnitude())


def ways_off(found: list[Registration], poses: list[Array]) -> Array:
    """(N,) metres from the true motion since the first scan."""
    return np.array([off(f.T_odom_sensor, inverse(poses[0]) @ T)[0] for f, T in zip(found, poses, strict=True)])


def step_errors(found: list[Registration], truth: Sequence[Array] | Array, scans: int = 1) -> Array:
    """(N, 2) metres and radians by which the motions over so many scans are wrong."""
    poses = [result.T_odom_sensor for result in found]
    pairs = zip(poses, poses[scans:], truth, truth[scans:], strict=False)
    return np.array([off(inverse(a) @ b, inverse(c) @ d) for a, b, c, d in pairs])


def from_file(value: Any) -> Any:
    """What the state of a run has of it."""
    return unpack(pack(value, Config()), Config())
