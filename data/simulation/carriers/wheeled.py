"""A robot on wheels: the sensor is level, but for stairs."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.simulation.carriers.carrier import Array
from data.simulation.drive import Drive, Robot

ROBOT = Robot()
LEAN = 0.15  # share of a stair's slope by which the sensor tilts: it is carried nearly level


@dataclass(frozen=True)
class Wheeled:
    """A `Carrier` that stands upright and takes the sensor along its way; it climbs stairs as if on legs."""

    name: str = "wheeled"
    robot: Robot = ROBOT
    height: float = 0.8
    top: float = 1.6
    rolling: bool = False

    def motion(self, drive: Drive, level: float, height: float, seed: int) -> "LevelMotion":
        """As in `Carrier`; without chance."""
        return LevelMotion(drive, level, height)


@dataclass(frozen=True)
class LevelMotion:
    """A `Motion` exactly along the drive."""

    drive: Drive
    level: float
    height: float

    @property
    def duration(self) -> float:
        """Seconds."""
        return self.drive.duration

    def ground(self, seconds: Array) -> Array:
        """As in `Motion`."""
        return self.drive.at(np.clip(seconds, 0.0, self.duration))

    def poses(self, seconds: Array) -> Array:
        """As in `Motion`."""
        poses = self.ground(seconds)
        T = np.tile(np.eye(4), (len(poses), 1, 1))
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        T[:, 0, 0], T[:, 0, 1], T[:, 1, 0], T[:, 1, 1] = c, -s, s, c
        T[:, :2, 3], T[:, 2, 3] = poses[:, :2], self.level + self.height
        if poses.shape[1] == 4:
            T[:, 2, 3] = poses[:, 3] + self.height
            T = T @ _nose_up(poses)
        return T


def _nose_up(poses: Array) -> NDArray[np.float64]:
    """(N, 4, 4) the tilt on stairs."""
    moved = np.gradient(poses, axis=0)
    forward = np.linalg.norm(moved[:, :2], axis=1)
    up = LEAN * np.arctan2(np.where(forward > 1e-6, moved[:, 3], 0.0), np.maximum(forward, 1e-6))
    T = np.tile(np.eye(4), (len(poses), 1, 1))
    T[:, 0, 0], T[:, 0, 2] = np.cos(up), -np.sin(up)
    T[:, 2, 0], T[:, 2, 2] = np.sin(up), np.cos(up)
    return T


WHEELED = Wheeled()
