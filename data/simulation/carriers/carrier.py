"""What a carrier is; a robot on wheels; motions as smooth curves through poses, and shaken ones."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from data.geometry.poses import xyzquat_to_poses
from data.simulation.drive import Drive, Robot

Array = NDArray[np.float64]
KNOTS = 50.0  # a second: well above what a hand does (its tremor ends at some 10 Hz)
LEAN = 0.15  # share of a stair's slope by which a robot's sensor tilts: it is carried nearly level
ROBOT = Robot()
SHAKES = 1.5  # Hz
FADED = 0.5  # s in which the shaking begins and ends
ROUNDED = 0.2  # s by which a walker's way is smoothed: no one starts, stops or turns at once


class Motion(Protocol):
    """A sensor's motion, `duration` seconds from rest to rest."""

    @property
    def duration(self) -> float: ...

    def ground(self, seconds: Array) -> Array:
        """x y yaw (N, 3) of the way below, or with the ground's z (N, 4), at times (N,) that increase."""

    def poses(self, seconds: Array) -> Array:
        """(N, 4, 4) T_bim_carrier at times (N,) that increase; x forward along the way, z up, where the sensor is."""


@dataclass(frozen=True)
class Carrier(ABC):
    """Who carries a sensor, `height` (m) above the floor.

    `robot` is how it drives or walks, `rolling` whether its scans are measured while it moves, unless effects say
    otherwise, and `top` (m) how far the body reaches above the floor.
    """

    name: str
    robot: Robot
    height: float
    top: float
    rolling: bool

    @abstractmethod
    def motion(self, drive: Drive, level: float, seed: int) -> Motion:
        """The sensor's motion along a drive on a floor at z = `level` (m)."""


@dataclass(frozen=True, eq=False)
class SmoothMotion:
    """A motion through poses `xyzquat` (N, 7) at KNOTS a second, twice continuously differentiable; `way` (N, 3 or 4)
    is the ground below."""

    xyzquat: Array
    way: Array

    @property
    def duration(self) -> float:
        """Seconds."""
        return (len(self.xyzquat) - 1) / KNOTS

    @cached_property
    def _spline(self) -> CubicSpline:
        quaternions = self.xyzquat[:, 3:]
        dots = np.sum(quaternions[1:] * quaternions[:-1], axis=1)
        signs = np.cumprod(np.concatenate([[1.0], np.where(dots < 0, -1.0, 1.0)]))
        rows = np.column_stack([self.xyzquat[:, :3], signs[:, None] * quaternions])
        return CubicSpline(np.arange(len(rows)) / KNOTS, rows)

    def ground(self, seconds: Array) -> Array:
        knots = np.arange(len(self.way)) / KNOTS
        return np.column_stack([np.interp(seconds, knots, column) for column in self.way.T])

    def poses(self, seconds: Array) -> Array:
        return xyzquat_to_poses(self._spline(np.clip(seconds, 0.0, self.duration)))


@dataclass(frozen=True)
class Wheeled(Carrier):
    """It stands upright and takes the sensor along its way; it climbs stairs as if on legs."""

    name: str = "wheeled"
    robot: Robot = ROBOT
    height: float = 0.8
    top: float = 1.6
    rolling: bool = False

    def motion(self, drive: Drive, level: float, seed: int) -> "LevelMotion":
        """As in `Carrier`; without chance."""
        return LevelMotion(drive, level, self.height)


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
        return self.drive.at(np.clip(seconds, 0.0, self.duration))

    def poses(self, seconds: Array) -> Array:
        poses = self.ground(seconds)
        T = np.tile(np.eye(4), (len(poses), 1, 1))
        c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
        T[:, 0, 0], T[:, 0, 1], T[:, 1, 0], T[:, 1, 1] = c, -s, s, c
        T[:, :2, 3], T[:, 2, 3] = poses[:, :2], self.level + self.height
        if poses.shape[1] == 4:
            T[:, 2, 3] = poses[:, 3] + self.height
            T = T @ _nose_up(poses)
        return T


def _nose_up(poses: Array) -> Array:
    """(N, 4, 4) the tilt on stairs."""
    moved = np.gradient(poses, axis=0)
    forward = np.linalg.norm(moved[:, :2], axis=1)
    up = LEAN * np.arctan2(np.where(forward > 1e-6, moved[:, 3], 0.0), np.maximum(forward, 1e-6))
    T = np.tile(np.eye(4), (len(poses), 1, 1))
    T[:, 0, 0], T[:, 0, 2] = np.cos(up), -np.sin(up)
    T[:, 2, 0], T[:, 2, 2] = np.sin(up), np.cos(up)
    return T


WHEELED = Wheeled()


@dataclass(frozen=True)
class _Shaken(Carrier):
    carrier: Carrier
    begin: float
    lasts: float
    rate: float

    def motion(self, drive: Drive, level: float, seed: int) -> Motion:
        return _ShakenMotion(self.carrier.motion(drive, level, seed), self)


def shaken(carrier: Carrier, begin: float, lasts: float = 10.0, rate: float = 300.0) -> Carrier:
    """The carrier, who turns the sensor to and fro, from `begin` on for `lasts` seconds, at up to `rate` degrees a
    second, about an axis that changes."""
    own = (f"{carrier.name}, shaken", carrier.robot, carrier.height, carrier.top, carrier.rolling)
    return _Shaken(*own, carrier, begin, lasts, rate)


@dataclass(frozen=True)
class _ShakenMotion:
    calm: Motion
    shaken: "_Shaken"

    @property
    def duration(self) -> float:
        return self.calm.duration

    def ground(self, seconds: Array) -> Array:
        return self.calm.ground(seconds)

    def poses(self, seconds: Array) -> Array:
        since = np.asarray(seconds, float) - self.shaken.begin
        faded = np.clip(np.minimum(since, self.shaken.lasts - since) / FADED, 0.0, 1.0)
        phase = 2 * np.pi * SHAKES * since
        swing = np.radians(self.shaken.rate) / (2 * np.pi * SHAKES) * faded * faded * (3 - 2 * faded) * np.sin(phase)
        axes = np.column_stack([np.cos(0.7 * since), np.sin(0.7 * since), np.ones(len(since))])
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        poses = self.calm.poses(seconds)
        poses[:, :3, :3] = poses[:, :3, :3] @ Rotation.from_rotvec(swing[:, None] * axes).as_matrix()
        return poses


def rounded_way(drive: Drive, level: float) -> Array:
    """(N, 4) x y yaw and the ground's z of a drive, KNOTS a second, smoothed in time as a walker's steps do."""
    way = drive.at(np.arange(int(drive.duration * KNOTS) + 1) / KNOTS)
    if way.shape[1] == 3:
        way = np.column_stack([way, np.full(len(way), level)])
    return np.asarray(gaussian_filter1d(way, ROUNDED * KNOTS, axis=0, mode="nearest"))


def bounded(offset: Array, most: float) -> Array:
    """Offsets (N, ...) in metres that stay below `most`, smoothly."""
    return most * np.tanh(offset / most)
