"""The motion of a carried sensor: along a drive, smooth through poses, shaken."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from data.geometry.poses import xyzquat_to_poses
from data.simulation.drive import Drive

Array = NDArray[np.float64]
KNOTS = 50.0  # a second: well above what a hand does (its tremor ends at some 10 Hz)
LEAN = 0.15  # share of a stair's slope by which a robot's sensor tilts: it is carried nearly level
SHAKES = 1.5  # Hz
FADED = 0.5  # s in which the shaking begins and ends


@dataclass(frozen=True)
class Motion:
    """A sensor's motion, `duration` seconds from rest to rest.

    At times (N,) that increase, `ground` gives x y yaw z (N, 4) of the way below, `poses` T_bim_sensor (N, 4, 4), with
    x forward along the way and z up unless the sensor is mounted otherwise.
    """

    duration: float
    ground: Callable[[Array], Array]
    poses: Callable[[Array], Array]

    def turned(self, R_of: Callable[[Array], Rotation]) -> "Motion":
        """The motion of a sensor that is turned in its place besides, by rotations at times (N,)."""

        def poses(seconds: Array) -> Array:
            T = self.poses(seconds)
            T[:, :3, :3] = T[:, :3, :3] @ R_of(seconds).as_matrix()
            return T

        return replace(self, poses=poses)

    def shaken(self, begin: float, lasts: float = 10.0, rate: float = 300.0) -> "Motion":
        """The sensor is turned to and fro, from `begin` on for `lasts` seconds, at up to `rate` degrees a second, about
        an axis that changes."""

        def swing(seconds: Array) -> Rotation:
            since = seconds - begin
            faded = np.clip(np.minimum(since, lasts - since) / FADED, 0.0, 1.0)
            phase = 2 * np.pi * SHAKES * since
            angle = np.radians(rate) / (2 * np.pi * SHAKES) * faded * faded * (3 - 2 * faded) * np.sin(phase)
            axes = np.column_stack([np.cos(0.7 * since), np.sin(0.7 * since), np.ones(len(since))])
            axes /= np.linalg.norm(axes, axis=1, keepdims=True)
            return Rotation.from_rotvec(angle[:, None] * axes)

        return self.turned(swing)


def level_motion(drive: Drive, height: float) -> Motion:
    """Exactly along the drive, `height` (m) above the ground."""

    def poses(seconds: Array) -> Array:
        ground = drive.at(seconds)
        T = np.tile(np.eye(4), (len(ground), 1, 1))
        c, s = np.cos(ground[:, 2]), np.sin(ground[:, 2])
        T[:, 0, 0], T[:, 0, 1], T[:, 1, 0], T[:, 1, 1] = c, -s, s, c
        T[:, :2, 3], T[:, 2, 3] = ground[:, :2], ground[:, 3] + height
        return T @ _nose_up(ground)

    return Motion(drive.duration, drive.at, poses)


def _nose_up(ground: Array) -> Array:
    """(N, 4, 4) the tilt on stairs."""
    moved = np.gradient(ground, axis=0) if len(ground) > 1 else np.zeros_like(ground)
    forward = np.linalg.norm(moved[:, :2], axis=1)
    up = LEAN * np.arctan2(np.where(forward > 1e-6, moved[:, 3], 0.0), np.maximum(forward, 1e-6))
    T = np.tile(np.eye(4), (len(ground), 1, 1))
    T[:, 0, 0], T[:, 0, 2] = np.cos(up), -np.sin(up)
    T[:, 2, 0], T[:, 2, 2] = np.sin(up), np.cos(up)
    return T


def smooth_motion(xyzquat: Array, way: Array) -> Motion:
    """Through poses `xyzquat` (N, 7) at KNOTS a second, twice continuously differentiable, over the ground `way`
    (N, 4)."""
    knots, quaternions = np.arange(len(xyzquat)) / KNOTS, xyzquat[:, 3:]
    spline = CubicSpline(knots, np.column_stack([xyzquat[:, :3], continuous(quaternions)]))

    def ground(seconds: Array) -> Array:
        return np.column_stack([np.interp(seconds, knots, column) for column in way.T])

    def poses(seconds: Array) -> Array:
        return xyzquat_to_poses(spline(np.clip(seconds, 0.0, knots[-1])))

    return Motion(float(knots[-1]), ground, poses)


def continuous(quaternions: Array) -> Array:
    """Quaternions (N, 4) with signs that do not jump from one to the next."""
    dots = np.sum(quaternions[1:] * quaternions[:-1], axis=1)
    signs = np.cumprod(np.concatenate([[1.0], np.where(dots < 0, -1.0, 1.0)]))
    return np.asarray(signs[:, None] * quaternions)
