"""What a real range finder makes of a ray: a bias of each beam, mixed pixels, loss at grazing angles."""

from dataclasses import dataclass, is_dataclass, replace

import numpy as np
from numpy.typing import NDArray

from data.simulation.sensor import Sensor

Array = NDArray[np.float64]
NOISE, BIAS = 0.03, 0.01  # m, standard deviations: of each range, and of each beam for good
REACH = 30.0  # m
EDGE = 0.3  # m between the ranges of neighbours: an edge
MIXED = 0.3  # share of the rays at an edge that give a range between
GRAZING = np.cos(np.radians([80.0, 88.0]))  # up to the first no ray is lost, from the second on all are


@dataclass(frozen=True, eq=False)
class Returns:
    """Ray i is cast by laser `i % beams`; `bias` (beams,) in metres."""

    bias: Array

    @staticmethod
    def of(beams: int, seed: int) -> "Returns":
        """A sensor's own biases."""
        return Returns(np.random.default_rng([seed, 51]).normal(0.0, BIAS, beams))

    def measured(self, ranges: Array, cosines: Array, rng: np.random.Generator) -> Array:
        """(N,) ranges (N,) as the sensor tells them, without their noise; `cosines` (N,) are those of the incidence."""
        lost = rng.random(len(ranges)) < (GRAZING[0] - cosines) / (GRAZING[0] - GRAZING[1])
        measured, beams = ranges.copy(), len(self.bias)
        both = np.isfinite(ranges[beams:]) & np.isfinite(ranges[:-beams])
        step = np.where(both, ranges[beams:], 0.0) - np.where(both, ranges[:-beams], 0.0)
        mixed = (np.abs(step) > EDGE) & (rng.random(len(step)) < MIXED)
        measured[:-beams][mixed] += rng.random(int(mixed.sum())) * step[mixed]
        measured += np.resize(self.bias, len(measured))
        return np.where(lost, np.inf, measured)


def noisy(sensor: Sensor) -> Sensor:
    """The sensor with more noise and less reach."""
    assert is_dataclass(sensor) and not isinstance(sensor, type)
    return replace(sensor, range_noise=NOISE, max_range=min(REACH, sensor.max_range))
