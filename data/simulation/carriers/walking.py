"""A person who walks with the sensor: steps, sway, a wandering attitude, glances.

The size of the motions is fitted to published statistics of hand-held surveys indoors, not to one recording: of a calm
hand, the tilt from the mean attitude is 3.7 degrees in the median and 12.6 in 95 %, the rate of turn 22 and 70 degrees
a second.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from data.simulation.carriers.carrier import KNOTS, Array, Carrier, SmoothMotion, bounded, rounded_way
from data.simulation.drive import Drive, Robot

STEP_RATE = 1.9  # steps a second
NEAREST = 0.12  # m: the sensor stays so far from what the way keeps clear of
PERSON = Robot(radius=0.25, speed=1.1, acceleration=1.2, yaw_rate=1.2, yaw_acceleration=4.0, rest=1.0, stair_speed=0.6)


@dataclass(frozen=True)
class Walker(Carrier):
    """Metres, seconds, degrees; standard deviations where not said otherwise.

    `bob` is the amplitude of the sensor's rise at each step, `sway` to the sides at each second step; `tilt_deg` the
    wandering of roll and pitch, which takes `tilt_time`, `liveliness` how much its size differs from time to time
    (logarithm); `rock_deg` what each step adds; `glance_deg` the swing of a glance to the side. The sensor is moved by
    its tilt at the end of `lever`, the pole's length above the hands.
    """

    name: str = "handheld"
    robot: Robot = PERSON
    height: float = 1.4
    top: float = 1.75
    rolling: bool = True
    bob: float = 0.02
    sway: float = 0.02
    tilt_deg: float = 3.15
    tilt_time: float = 1.5
    liveliness: float = 0.57
    rock_deg: float = 0.6
    glance_deg: float = 15.0
    lever: float = 0.0

    def motion(self, drive: Drive, level: float, seed: int) -> SmoothMotion:
        way, rng = rounded_way(drive, level), np.random.default_rng([seed, 31])
        yaw, roll, pitch = self._attitude(way, rng)
        attitude = Rotation.from_euler("ZYX", np.column_stack([yaw, pitch, roll]))
        offset = self._steps(way, rng)
        offset += self.lever * np.column_stack([np.sin(pitch), -np.sin(roll), np.cos(pitch) * np.cos(roll) - 1])
        offset[:, :2] = bounded(offset[:, :2], self.robot.radius - NEAREST)
        places = np.column_stack([way[:, :2], way[:, 3] + self.height]) + turned(offset, way[:, 2])
        return SmoothMotion(np.column_stack([places, attitude.as_quat()]), way)

    def _steps(self, way: Array, rng: np.random.Generator) -> Array:
        """(N, 3) forward, left and up: what the steps do, as large as the walk is quick."""
        walk, phase = _walk(way, self.robot.speed), _phase(len(way), rng)
        slow = np.column_stack([wander(rng, len(way), 1.5) for _ in range(3)]) * [0.02, 0.015, 0.015]
        across, up = self.sway * np.sin(phase / 2), self.bob * np.sin(phase)
        return slow + walk[:, None] * np.column_stack([0.3 * self.bob * np.cos(phase), across, up])

    def _attitude(self, way: Array, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """Yaw, roll and pitch (N,) in radians."""
        count, walk = len(way), _walk(way, self.robot.speed)
        phase, lively = _phase(count, rng), np.exp(self.liveliness * wander(rng, count, 2.5))
        roll, pitch = (np.radians(self.tilt_deg) * lively * wander(rng, count, self.tilt_time) for _ in range(2))
        rock = np.radians(self.rock_deg) * walk
        roll += rock * np.sin(phase / 2 + 0.5)
        pitch += 0.6 * rock * np.sin(phase + 1.0)
        yaw = way[:, 2] + rock * np.sin(phase / 2) + np.radians(3.0) * lively * wander(rng, count, 0.8)
        return yaw + np.radians(self.glance_deg) * _glances(rng, count), roll, pitch


def wander(rng: np.random.Generator, count: int, time: float) -> Array:
    """(N,) a random curve of zero mean and unit variance, KNOTS a second, that changes within `time` seconds."""
    width = time / 2 * KNOTS
    margin = int(4 * width)
    smooth = gaussian_filter1d(rng.normal(size=count + 2 * margin), width)[margin : margin + count]
    return np.asarray(smooth * np.sqrt(2 * np.sqrt(np.pi) * width))


def _walk(way: Array, speed: float) -> Array:
    """(N,) how quick the walk is, 1 at full speed."""
    steps = np.linalg.norm(np.gradient(way[:, :2], axis=0), axis=1) * KNOTS / speed
    return np.asarray(gaussian_filter1d(steps, 0.3 * KNOTS, mode="nearest"))


def _phase(count: int, rng: np.random.Generator) -> Array:
    """(N,) radians, one turn a step; steps are not all equally long."""
    rate = STEP_RATE * (1 + 0.04 * wander(rng, count, 2.0))
    return np.asarray(rng.uniform(0, 4 * np.pi) + 2 * np.pi * np.cumsum(rate) / KNOTS)


def _glances(rng: np.random.Generator, count: int) -> Array:
    """(N,) looks to the side and back, every six seconds or so, half a second to a second and a half each."""
    t, swing = np.arange(count) / KNOTS, np.zeros(count)
    at = rng.exponential(6.0)
    while at < count / KNOTS:
        swing += rng.normal() * np.exp(-(((t - at) / rng.uniform(0.3, 0.9)) ** 2))
        at += 1.0 + rng.exponential(5.0)
    return swing


def turned(offset: Array, yaw: Array) -> Array:
    """Offsets (N, 3) turned about z by yaw (N,)."""
    c, s = np.cos(yaw), np.sin(yaw)
    x, y = offset[:, 0], offset[:, 1]
    return np.column_stack([c * x - s * y, s * x + c * y, offset[:, 2]])


HANDHELD = Walker()
POLE = Walker(
    name="pole", height=1.9, top=1.95, bob=0.015, sway=0.01, tilt_deg=2.5, tilt_time=2.0, liveliness=0.4, rock_deg=0.4,
    glance_deg=10.0, lever=0.8,
)  # fmt: skip
