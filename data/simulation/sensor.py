"""What a LiDAR is to the simulation, and the spinning one."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError

Array = NDArray[np.float64]


class Scene(Protocol):
    """What rays can hit."""

    def distances(self, origins: Array, directions: Array) -> Array:
        """(N,) metres along unit `directions` (N, 3) from `origins`, (3,) or (N, 3); inf where nothing is."""


class Sensor(Protocol):
    """Sensor frame: x forward, y left, z up. Ranges in metres, `rate` in scans a second.

    `range_noise` is the standard deviation of a Gaussian error along the beam. Ray i is cast by laser `i % beams`.
    """

    @property
    def beams(self) -> int: ...

    @property
    def range_noise(self) -> float: ...

    @property
    def min_range(self) -> float: ...

    @property
    def max_range(self) -> float: ...

    @property
    def rate(self) -> float: ...

    def rays(self, scan: int) -> tuple[Array, Array]:
        """Directions (N, 3), unit vectors in the sensor frame, of the scan with this number, and their times (N,) in
        seconds after its stamp, from 0 to less than 1 / `rate`, in order of time."""


@dataclass(frozen=True)
class SpinningSensor:
    """Beams one over another that turn about the z axis; a `Sensor`. Angles in degrees."""

    beams: int = 16
    lowest_deg: float = -15.0
    highest_deg: float = 15.0
    azimuths: int = 900
    range_noise: float = 0.02
    min_range: float = 0.3
    max_range: float = 100.0
    rate: float = 10.0

    def __post_init__(self) -> None:
        """Raises UserError for an impossible sensor."""
        if self.beams < 1 or self.azimuths < 1 or not self.rate > 0:
            raise UserError("sensor: beams, azimuths and rate must be positive")
        if not -90 <= self.lowest_deg <= self.highest_deg <= 90:
            raise UserError("sensor: elevations must rise from lowest to highest, within -90 and 90 degrees")
        if not 0 <= self.min_range < self.max_range or not self.range_noise >= 0:
            raise UserError("sensor: ranges must be 0 <= min < max, and the noise must not be negative")

    @cached_property
    def directions(self) -> Array:
        """(azimuths * beams, 3) unit vectors in the sensor frame, turning left from x, beams lowest first."""
        azimuth = np.linspace(-np.pi, np.pi, self.azimuths, endpoint=False)
        elevation = np.radians(np.linspace(self.lowest_deg, self.highest_deg, self.beams))
        a, e = np.meshgrid(azimuth, elevation, indexing="ij")
        return np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1).reshape(-1, 3)

    @cached_property
    def _seconds(self) -> Array:
        return np.repeat(np.arange(self.azimuths) / (self.azimuths * self.rate), self.beams)

    def rays(self, scan: int) -> tuple[Array, Array]:
        """As in `Sensor`; all scans are alike."""
        return self.directions, self._seconds

    def scan(self, scene: Scene, T_bim_sensor: Array, rng: np.random.Generator) -> NDArray[np.float32]:
        """As `snapshot`."""
        return snapshot(self, scene, T_bim_sensor, rng)


def snapshot(
    sensor: Sensor, scene: Scene, T_bim_sensor: Array, rng: np.random.Generator, scan: int = 0
) -> NDArray[np.float32]:
    """(N, 3) points in the sensor frame, all measured at one instant: no motion distortion.

    Rays that hit nothing between `min_range` and `max_range` give no point.
    """
    directions, _ = sensor.rays(scan)
    ranges = scene.distances(T_bim_sensor[:3, 3], directions @ T_bim_sensor[:3, :3].T)
    return _points(sensor, directions, ranges, rng)[0]


def moving_scan(
    sensor: Sensor, scene: Scene, T_bim_sensor: Array, rng: np.random.Generator, scan: int = 0
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """A scan of a sensor that moves meanwhile: `T_bim_sensor` (M, 4, 4) are its poses at the M different times of the
    scan's rays.

    Returns (N, 3) points, each in the sensor's frame at its own time, and (N,) these times in seconds after the stamp.
    """
    directions, seconds = sensor.rays(scan)
    T = T_bim_sensor[instant_of(seconds)]
    turned = np.einsum("nij,nj->ni", T[:, :3, :3], directions)
    points, seen = _points(sensor, directions, scene.distances(T[:, :3, 3], turned), rng)
    return points, seconds[seen].astype(np.float32)


def instants(seconds: Array) -> Array:
    """(M,) the different ones of times (N,) in order."""
    return seconds[np.diff(seconds, prepend=-1.0) > 0]


def instant_of(seconds: Array) -> NDArray[np.int_]:
    """(N,) the index into `instants` of each time."""
    return np.cumsum(np.diff(seconds, prepend=-1.0) > 0) - 1


def _points(
    sensor: Sensor, directions: Array, ranges: Array, rng: np.random.Generator
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Noisy points of those rays that return, and which do."""
    seen = (ranges >= sensor.min_range) & (ranges <= sensor.max_range)
    measured = ranges[seen] + rng.normal(0.0, sensor.range_noise, int(seen.sum()))
    return (directions[seen] * measured[:, None]).astype(np.float32), seen
