"""Sensors by the names of products that they resemble: their fields of view, rays and patterns.

All have the same range noise (2 cm), so that a comparison shows what the pattern does.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass, replace

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.simulation.sensor import Sensor, SpinningSensor

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PatternSensor:
    """Rays along a curve that does not repeat from scan to scan: a `Sensor`.

    `curve` gives azimuth and elevation (N,), radians, at times (N,) in seconds since the drive's beginning.
    """

    curve: Callable[[Array], tuple[Array, Array]]
    points: int
    beams: int = 1
    range_noise: float = 0.02
    min_range: float = 0.3
    max_range: float = 70.0
    rate: float = 10.0

    def rays(self, scan: int) -> tuple[Array, Array]:
        """As in `Sensor`."""
        seconds = np.arange(self.points) / (self.points * self.rate)
        a, e = self.curve(scan / self.rate + seconds)
        return np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=-1), seconds


def dome(t: Array) -> tuple[Array, Array]:
    """A mirror that turns and nods, as that of a Livox Mid-360: 360 degrees by -7 to 52.

    The turns (71.3 a second) and the nods (331.7) have no short common period, so that scans fall between one another.
    """
    azimuth = (2 * np.pi * 71.3 * t + np.pi) % (2 * np.pi) - np.pi
    nod = np.abs((331.7 * t) % 2.0 - 1.0)
    return azimuth, np.radians(-7.0 + 59.0 * nod)


def rosette(t: Array) -> tuple[Array, Array]:
    """Two prisms that turn against each other, as those of a Livox Avia: 70 degrees wide, 77 high.

    The speeds are those published for the Livox Mid-40, 7294 and -4664 turns a minute.
    """
    first, second = 2 * np.pi * (7294 / 60) * t, -2 * np.pi * (4664 / 60) * t
    right, up = (np.cos(first) + np.cos(second)) / 2, (np.sin(first) + np.sin(second)) / 2
    return np.radians(35.0) * right, np.radians(38.5) * up


SENSORS: dict[str, Sensor] = {
    "VLP-16": SpinningSensor(),
    "OS0-32": SpinningSensor(32, -45.0, 45.0, 1024, max_range=50.0),
    "OS1-64": SpinningSensor(64, -22.5, 22.5, 512),  # its mode of 512 azimuths; 1024 with `--azimuths`
    "XT32": SpinningSensor(32, -16.0, 15.0, 1000),
    "Mid-360": PatternSensor(dome, 20_000),
    "sector": PatternSensor(rosette, 24_000),
}


def sensor_named(name: str, azimuths: int | None = None) -> Sensor:
    """The sensor of this name, with another number of azimuths if given.

    Raises UserError for an unknown name, and for azimuths of a sensor that does not spin.
    """
    found = {known.casefold(): sensor for known, sensor in SENSORS.items()}.get(name.casefold())
    if found is None:
        raise UserError(f"sensor '{name}' is not known; give one of {', '.join(SENSORS)}")
    if azimuths is None:
        return found
    if not isinstance(found, SpinningSensor):
        raise UserError(f"sensor {name} does not spin; leave out its azimuths")
    return replace(found, azimuths=azimuths)


def described(sensor: Sensor) -> dict[str, object]:
    """The sensor's settings, for JSON."""
    assert is_dataclass(sensor) and not isinstance(sensor, type)
    settings = {field.name: getattr(sensor, field.name) for field in fields(sensor)}
    return {name: getattr(value, "__name__", value) for name, value in settings.items()}
