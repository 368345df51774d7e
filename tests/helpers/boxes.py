"""Scenes of boxes, and scans of them."""

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from data.geometry.raycast import BOX_FACES, TriangleScene
from data.simulation import Sensor

Array = NDArray[np.float64]
Box = tuple[float, float, float, float, float, float]  # lowest x y z, highest x y z
_CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)


def scene_of(boxes: Iterable[Box]) -> TriangleScene:
    """What a sensor sees among solid boxes."""
    return TriangleScene(triangles_of(boxes))


def triangles_of(boxes: Iterable[Box]) -> Array:
    """(M, 3, 3) the faces of solid boxes."""
    limits = np.array(list(boxes)).reshape(-1, 2, 1, 3)
    return np.asarray((limits[:, 0] + _CORNERS * (limits[:, 1] - limits[:, 0]))[:, BOX_FACES].reshape(-1, 3, 3))


def room(x0: float, y0: float, x1: float, y1: float, height: float = 2.6, wall: float = 0.2) -> list[Box]:
    """A closed room by its inner faces: four walls, floor at z = 0, ceiling."""
    a, b, c, d = x0 - wall, y0 - wall, x1 + wall, y1 + wall
    walls: list[Box] = [(a, b, 0, c, y0, height), (a, y1, 0, c, d, height)]
    walls += [(a, y0, 0, x0, y1, height), (x1, y0, 0, c, y1, height)]
    return [*walls, (a, b, -wall, c, d, 0), (a, b, height, c, d, height + wall)]


def pose(x: float, y: float, z: float = 0.8, yaw: float = 0.0, pitch: float = 0.0, roll: float = 0.0) -> Array:
    """(4, 4) T_scene_sensor; angles in radians."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_matrix()
    T[:3, 3] = x, y, z
    return T


def scan(scene: TriangleScene, T_scene_sensor: Array, sensor: Sensor | None = None, seed: int = 0) -> Array:
    """(N, 3) points in the sensor frame, 2 cm noise."""
    return (sensor or Sensor()).scan(scene, T_scene_sensor, np.random.default_rng(seed))[0].astype(float)
