"""What a carrier is, and motions as smooth curves through poses."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from data.geometry.poses import xyzquat_to_poses
from data.simulation.drive import Drive, Robot

Array = NDArray[np.float64]
KNOTS = 50.0  # a second: well above what a hand does (its tremor ends at some 10 Hz)
ROUNDED = 0.2  # s by which a walker's way is smoothed: no one starts, stops or turns at once


class Motion(Protocol):
    """A sensor's motion, `duration` seconds from rest to rest."""

    @property
    def duration(self) -> float: ...

    def ground(self, seconds: Array) -> Array:
        """x y yaw (N, 3) of the way below, or with the ground's z (N, 4), at times (N,) that increase."""

    def poses(self, seconds: Array) -> Array:
        """(N, 4, 4) T_bim_carrier at times (N,) that increase; x forward along the way, z up, where the sensor is."""


class Carrier(Protocol):
    """`robot` is how it drives or walks, `rolling` whether its scans are measured while it moves, unless effects
    say otherwise, and `top` (m) how far the body reaches above the floor."""

    @property
    def name(self) -> str: ...

    @property
    def robot(self) -> Robot: ...

    @property
    def rolling(self) -> bool: ...

    @property
    def top(self) -> float: ...

    @property
    def height(self) -> float:
        """Metres of the sensor above the floor, unless another height is given."""

    def motion(self, drive: Drive, level: float, height: float, seed: int) -> Motion:
        """The sensor's motion along a drive on a floor at z = `level` (m), `height` (m) above it."""


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
        """As in `Motion`."""
        knots = np.arange(len(self.way)) / KNOTS
        return np.column_stack([np.interp(seconds, knots, column) for column in self.way.T])

    def poses(self, seconds: Array) -> Array:
        """As in `Motion`."""
        return xyzquat_to_poses(self._spline(np.clip(seconds, 0.0, self.duration)))


def rounded_way(drive: Drive, level: float) -> Array:
    """(N, 4) x y yaw and the ground's z of a drive, KNOTS a second, smoothed in time as a walker's steps do."""
    way = drive.at(np.arange(int(drive.duration * KNOTS) + 1) / KNOTS)
    if way.shape[1] == 3:
        way = np.column_stack([way, np.full(len(way), level)])
    return np.asarray(gaussian_filter1d(way, ROUNDED * KNOTS, axis=0, mode="nearest"))


def bounded(offset: Array, most: float) -> Array:
    """Offsets (N, ...) in metres that stay below `most`, smoothly."""
    return most * np.tanh(offset / most)
