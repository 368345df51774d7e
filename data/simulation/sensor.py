"""A spinning LiDAR: the directions of its beams, and its measurements in a scene of triangles."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.geometry.raycast import TriangleScene


@dataclass(frozen=True)
class SpinningSensor:
    """Sensor frame: x forward, y left, z up. Angles in degrees, ranges in metres, `rate` in turns a second.

    `range_noise` is the standard deviation of a Gaussian error along the beam.
    """

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
    def directions(self) -> NDArray[np.float64]:
        """(azimuths * beams, 3) unit vectors in the sensor frame, turning left from x, beams lowest first."""
        azimuth = np.linspace(-np.pi, np.pi, self.azimuths, endpoint=False)
        elevation = np.radians(np.linspace(self.lowest_deg, self.highest_deg, self.beams))
        a, e = np.meshgrid(azimuth, elevation, indexing="ij")
        return np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1).reshape(-1, 3)

    def scan(
        self, scene: TriangleScene, T_bim_sensor: NDArray[np.float64], rng: np.random.Generator
    ) -> NDArray[np.float32]:
        """(N, 3) points in the sensor frame, all measured at one instant: no motion distortion.

        Beams that hit nothing between `min_range` and `max_range` give no point.
        """
        directions = self.directions
        ranges = scene.distances(T_bim_sensor[:3, 3], directions @ T_bim_sensor[:3, :3].T)
        seen = (ranges >= self.min_range) & (ranges <= self.max_range)
        measured = ranges[seen] + rng.normal(0.0, self.range_noise, int(seen.sum()))
        return (directions[seen] * measured[:, None]).astype(np.float32)

    def sweep(
        self, scene: TriangleScene, T_bim_sensor: NDArray[np.float64], rng: np.random.Generator
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """One turn of a sensor that moves meanwhile: `T_bim_sensor` (azimuths, 4, 4) is its pose at each azimuth.

        Returns (N, 3) points, each in the sensor's frame at its own time, and (N,) these times in seconds after the
        first azimuth's.
        """
        directions = self.directions.reshape(self.azimuths, self.beams, 3)
        turned = (directions @ T_bim_sensor[:, :3, :3].transpose(0, 2, 1)).reshape(-1, 3)
        ranges = scene.distances(np.repeat(T_bim_sensor[:, :3, 3], self.beams, axis=0), turned)
        seen = (ranges >= self.min_range) & (ranges <= self.max_range)
        measured = ranges[seen] + rng.normal(0.0, self.range_noise, int(seen.sum()))
        times = np.repeat(np.arange(self.azimuths) / (self.azimuths * self.rate), self.beams)
        return (self.directions[seen] * measured[:, None]).astype(np.float32), times[seen].astype(np.float32)
