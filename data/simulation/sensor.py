"""A simulated LiDAR, and an IMU in it."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from data.common.errors import UserError
from data.imu import GRAVITY, ImuSamples

Array = NDArray[np.float64]
Points = NDArray[np.float32]
RATE = 200  # samples a second
_CHANCE = 53  # makes the noise another one than that of the scans of the same seed
_MDPS, _UG, _DEG_H = np.radians(1e-3), 1e-6 * GRAVITY, np.radians(1.0) / 3600


class Scene(Protocol):
    """What rays can hit."""

    def distances(self, origins: Array, directions: Array) -> Array:
        """(N,) metres along unit `directions` (N, 3) from `origins`, (3,) or (N, 3); inf where nothing is."""


@dataclass(frozen=True)
class Sensor:
    """Beams one over another that turn about the z axis, all scans alike; or with a `curve` one beam that follows it,
    and does not repeat from scan to scan.

    Sensor frame: x forward, y left, z up. Angles in degrees, ranges in metres, `rate` in scans a second; `range_noise`
    is the standard deviation of a Gaussian error along the beam. Each beam is cast at `azimuths` times of a scan. Rays
    that hit nothing between `min_range` and `max_range` give no point. `curve` gives azimuth and elevation (N,),
    radians, at times (N,) in seconds since the drive's beginning.
    """

    beams: int = 16
    lowest_deg: float = -15.0
    highest_deg: float = 15.0
    azimuths: int = 900
    range_noise: float = 0.02
    min_range: float = 0.3
    max_range: float = 100.0
    rate: float = 10.0
    curve: Callable[[Array], tuple[Array, Array]] | None = None

    @cached_property
    def instants(self) -> Array:
        """(M,) the times at which the beams are cast, in seconds after a scan's stamp."""
        return np.arange(self.azimuths) / (self.azimuths * self.rate)

    @cached_property
    def seconds(self) -> Array:
        """(N,) when each ray is cast, likewise. Ray i is cast by beam `i % beams`."""
        return np.repeat(self.instants, self.beams)

    @cached_property
    def _spun(self) -> Array:
        """(N, 3) turning left from x, beams lowest first."""
        azimuth = np.linspace(-np.pi, np.pi, self.azimuths, endpoint=False)
        elevation = np.radians(np.linspace(self.lowest_deg, self.highest_deg, self.beams))
        return _unit(np.repeat(azimuth, self.beams), np.tile(elevation, self.azimuths))

    def rays(self, scan: int) -> Array:
        """(N, 3) directions, unit vectors in the sensor frame, of the scan with this number."""
        return self._spun if self.curve is None else _unit(*self.curve(scan / self.rate + self.seconds))

    def scan(
        self, scene: Scene, T_bim_sensor: Array, rng: np.random.Generator, number: int = 0
    ) -> tuple[Points, NDArray[np.float32]]:
        """(N, 3) noisy points of the rays that return, each in the sensor's frame at its own time, and (N,) these times
        in seconds after the stamp. `T_bim_sensor` (M, 4, 4) are the sensor's poses at the `instants`; one (4, 4): it
        stands still."""
        directions = self.rays(number)
        if T_bim_sensor.ndim == 2:
            ranges = scene.distances(T_bim_sensor[:3, 3], directions @ T_bim_sensor[:3, :3].T)
        else:
            T = np.repeat(T_bim_sensor, self.beams, axis=0)
            ranges = scene.distances(T[:, :3, 3], np.einsum("nij,nj->ni", T[:, :3, :3], directions))
        seen = (ranges >= self.min_range) & (ranges <= self.max_range)
        measured = ranges[seen] + rng.normal(0.0, self.range_noise, int(seen.sum()))
        return (directions[seen] * measured[:, None]).astype(np.float32), self.seconds[seen].astype(np.float32)


def _unit(azimuth: Array, elevation: Array) -> Array:
    """(N, 3) unit vectors."""
    level = np.cos(elevation)
    return np.stack([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1)


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


VLP_16 = Sensor()
# by the names of products that they resemble; all with the same noise, so that a comparison shows what the pattern does
SENSORS: dict[str, Sensor] = {
    "VLP-16": VLP_16,
    "OS0-32": Sensor(32, -45.0, 45.0, 1024, max_range=50.0),
    "OS1-64": Sensor(64, -22.5, 22.5, 512),  # its mode of 512 azimuths
    "XT32": Sensor(32, -16.0, 15.0, 1000),
    "Mid-360": Sensor(1, azimuths=20_000, max_range=70.0, curve=dome),
    "sector": Sensor(1, azimuths=24_000, max_range=70.0, curve=rosette),
}


def sensor_named(name: str) -> Sensor:
    """The sensor of this name. Raises UserError for an unknown one."""
    for known, sensor in SENSORS.items():
        if known.casefold() == name.casefold():
            return sensor
    raise UserError(f"sensor '{name}' is not known; give one of {', '.join(SENSORS)}")


def described(sensor: Sensor) -> dict[str, object]:
    """The sensor's settings, for JSON."""
    return asdict(replace(sensor, curve=None)) | {"curve": getattr(sensor.curve, "__name__", None)}


@dataclass(frozen=True)
class ImuModel:
    """Errors of gyroscope (rad/s) and accelerometer (m/s2), each axis by itself.

    `noise` are the densities of the white noise, a root of hertz; `walk` those of the biases' random walks, a root of a
    second; `bias` the standard deviations of the constant biases.
    """

    gyro_noise: float = 0.0
    gyro_walk: float = 0.0
    gyro_bias: float = 0.0
    accel_noise: float = 0.0
    accel_walk: float = 0.0
    accel_bias: float = 0.0


IMUS = {
    # ICM-40609-D, the chip in the Livox Mid-360: 4.5 mdps and 100 ug a root of hertz, offsets of 1 dps and 25 mg at
    # most (its data sheet; here two standard deviations). Random walks: of a chip of its class, in the calibration that
    # the EuRoC data comes with (gyroscope 1.9e-5; accelerometer 3e-3, which temperature caused, so a tenth of it).
    "mid360": ImuModel(4.5 * _MDPS, 1.9e-5, 500 * _MDPS, 100 * _UG, 3e-4, 12_500 * _UG),
    # STIM300 (its data sheet): 0.15 deg and 0.07 m/s a root of an hour, repeated within 4 deg/h and 0.75 mg; stable to
    # 0.5 deg/h and 0.05 mg, here taken for walks of a hundred seconds.
    "tactical": ImuModel(np.radians(0.15) / 60, 0.05 * _DEG_H, 4 * _DEG_H, 0.07 / 60, 5 * _UG, 750 * _UG),
}


def imu_named(name: str) -> ImuModel:
    """The IMU of this class; raises UserError for an unknown one."""
    if name not in IMUS:
        raise UserError(f"IMU '{name}' is not known; give one of {', '.join(IMUS)}")
    return IMUS[name]


def measured(poses: Callable[[Array], Array], seconds: float, model: ImuModel, seed: int) -> ImuSamples:
    """What an IMU measures for so many seconds, RATE a second, in the axes of the poses (N, 4, 4) at times (N,).

    The poses are in a frame with z up, and smooth. A sample is the mean over the time around it until halfway to its
    neighbours, as that of a unit that filters.
    """
    at, half = np.arange(int(seconds * RATE) + 1) / RATE, 0.5 / RATE
    before, middle, after = poses(at - half), poses(at), poses(at + half)
    turns = before[:, :3, :3].transpose(0, 2, 1) @ after[:, :3, :3]
    gyro = Rotation.from_matrix(turns).as_rotvec() * RATE
    acceleration = (before[:, :3, 3] - 2 * middle[:, :3, 3] + after[:, :3, 3]) / half**2
    accel = np.einsum("nji,nj->ni", middle[:, :3, :3], acceleration + np.array([0.0, 0.0, GRAVITY]))
    rng = np.random.default_rng([seed, _CHANCE])
    gyro += _errors(rng, len(at), model.gyro_noise, model.gyro_walk, model.gyro_bias)
    accel += _errors(rng, len(at), model.accel_noise, model.accel_walk, model.accel_bias)
    return ImuSamples(np.rint(at * 1e9).astype(np.int64), gyro, accel)


def _errors(rng: np.random.Generator, count: int, noise: float, walk: float, bias: float) -> Array:
    """(N, 3) white noise, a bias that wanders, and a constant one."""
    white = rng.normal(size=(count, 3)) * noise * np.sqrt(RATE)
    wandering = np.cumsum(rng.normal(size=(count, 3)), axis=0) * walk / np.sqrt(RATE)
    return np.asarray(white + wandering + rng.normal(size=3) * bias)
