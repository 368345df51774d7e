"""A carrier who shakes the sensor for a while."""

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from data.simulation.carriers.carrier import Array, Carrier, Motion
from data.simulation.drive import Drive, Robot

FREQUENCY = 1.5  # Hz
FADED = 0.5  # s in which the shaking begins and ends


@dataclass(frozen=True)
class Shaken:
    """A `carrier` who turns the sensor to and fro, from `begin` on for `lasts` seconds, at up to `rate` degrees a
    second, about an axis that changes."""

    carrier: Carrier
    begin: float
    lasts: float = 10.0
    rate: float = 300.0

    @property
    def name(self) -> str:
        """As in `Carrier`."""
        return f"{self.carrier.name}, shaken"

    @property
    def robot(self) -> Robot:
        """As in `Carrier`."""
        return self.carrier.robot

    @property
    def rolling(self) -> bool:
        """As in `Carrier`."""
        return self.carrier.rolling

    @property
    def top(self) -> float:
        """As in `Carrier`."""
        return self.carrier.top

    @property
    def height(self) -> float:
        """As in `Carrier`."""
        return self.carrier.height

    def motion(self, drive: Drive, level: float, height: float, seed: int) -> Motion:
        """As in `Carrier`."""
        return _ShakenMotion(self.carrier.motion(drive, level, height, seed), self)


@dataclass(frozen=True)
class _ShakenMotion:
    calm: Motion
    shaken: Shaken

    @property
    def duration(self) -> float:
        """As in `Motion`."""
        return self.calm.duration

    def ground(self, seconds: Array) -> Array:
        """As in `Motion`."""
        return self.calm.ground(seconds)

    def poses(self, seconds: Array) -> Array:
        """As in `Motion`."""
        since = np.asarray(seconds, float) - self.shaken.begin
        faded = np.clip(np.minimum(since, self.shaken.lasts - since) / FADED, 0.0, 1.0)
        phase = 2 * np.pi * FREQUENCY * since
        swing = np.radians(self.shaken.rate) / (2 * np.pi * FREQUENCY) * faded * faded * (3 - 2 * faded) * np.sin(phase)
        axes = np.column_stack([np.cos(0.7 * since), np.sin(0.7 * since), np.ones(len(since))])
        axes /= np.linalg.norm(axes, axis=1, keepdims=True)
        poses = self.calm.poses(seconds)
        poses[:, :3, :3] = poses[:, :3, :3] @ Rotation.from_rotvec(swing[:, None] * axes).as_matrix()
        return poses
