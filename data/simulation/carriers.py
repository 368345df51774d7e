"""Who carries the sensor along the way: a robot on wheels, a person who walks, or one whose motion was recorded.

A walker has steps, sway, a wandering attitude, glances. Their size is fitted to published statistics of hand-held
surveys indoors, not to one recording: of a calm hand, the tilt from the mean attitude is 3.7 degrees in the median and
12.6 in 95 %, the rate of turn 22 and 70 degrees a second. Of a recording the attitude, height and speed are taken, not
the place.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from data.common.errors import UserError
from data.geometry import se2
from data.geometry.poses import poses_to_xyzquat
from data.simulation.drive import KNOTS, Array, Drive, Motion, Robot, continuous, level_motion, smooth_motion
from data.trajectory import Trajectory

ROUNDED = 0.2  # s by which a walker's way is smoothed: no one starts, stops or turns at once
STEP_RATE = 1.9  # steps a second
NEAREST = 0.12  # m: the sensor stays so far from what the way keeps clear of
PERSON = Robot(radius=0.25, speed=1.1, acceleration=1.2, yaw_rate=1.2, yaw_acceleration=4.0, rest=1.0, stair_speed=0.6)
SMOOTH = 0.5  # s: the way is what is left of the recorded places after this
STANDING = 0.3  # m/s: below, the direction of the way is not known
SEAM = 1.0  # s over which the recording's end fades into its beginning
SHORTEST = 5.0  # s


@dataclass(frozen=True)
class Carrier:
    """Who carries a sensor, `height` (m) above the floor: a robot that stands upright, and climbs stairs as if on legs.

    `robot` is how it drives or walks, `rolling` whether its scans are measured while it moves, unless effects say
    otherwise, and `top` (m) how far the body reaches above the floor.
    """

    name: str
    robot: Robot
    height: float
    top: float
    rolling: bool

    def motion(self, drive: Drive, seed: int) -> Motion:
        """The sensor's motion along a drive."""
        return level_motion(drive, self.height)

    def _moved(self, way: Array, offset: Array, attitude: Rotation) -> Motion:
        """Over the ground `way` (N, 4), KNOTS a second, with the sensor off the middle by `offset` (N, 3), in metres
        forward, left and up, but not near what the way keeps clear of."""
        most = self.robot.radius - NEAREST
        x_y = most * np.tanh(offset[:, :2] / most)
        places = way[:, [0, 1, 3]] + [0.0, 0.0, self.height] + _turned(np.column_stack([x_y, offset[:, 2]]), way[:, 2])
        return smooth_motion(np.column_stack([places, attitude.as_quat()]), way)


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

    def motion(self, drive: Drive, seed: int) -> Motion:
        way, rng = _rounded_way(drive), np.random.default_rng([seed, 31])
        steps = np.linalg.norm(np.gradient(way[:, :2], axis=0), axis=1) * KNOTS / self.robot.speed
        walk = gaussian_filter1d(steps, 0.3 * KNOTS, mode="nearest")  # how quick it is, 1 at full speed
        yaw, roll, pitch = self._attitude(way[:, 2], walk, rng)
        offset = self._steps(walk, rng)
        offset += self.lever * np.column_stack([np.sin(pitch), -np.sin(roll), np.cos(pitch) * np.cos(roll) - 1])
        return self._moved(way, offset, Rotation.from_euler("ZYX", np.column_stack([yaw, pitch, roll])))

    def _steps(self, walk: Array, rng: np.random.Generator) -> Array:
        """(N, 3) forward, left and up: what the steps do, as large as the walk is quick."""
        phase = _phase(len(walk), rng)
        slow = np.column_stack([_wander(rng, len(walk), 1.5) for _ in range(3)]) * [0.02, 0.015, 0.015]
        across, up = self.sway * np.sin(phase / 2), self.bob * np.sin(phase)
        return slow + walk[:, None] * np.column_stack([0.3 * self.bob * np.cos(phase), across, up])

    def _attitude(self, heading: Array, walk: Array, rng: np.random.Generator) -> tuple[Array, Array, Array]:
        """Yaw, roll and pitch (N,) in radians."""
        count = len(walk)
        phase, lively = _phase(count, rng), np.exp(self.liveliness * _wander(rng, count, 2.5))
        roll, pitch = (np.radians(self.tilt_deg) * lively * _wander(rng, count, self.tilt_time) for _ in range(2))
        rock = np.radians(self.rock_deg) * walk
        roll += rock * np.sin(phase / 2 + 0.5)
        pitch += 0.6 * rock * np.sin(phase + 1.0)
        yaw = heading + rock * np.sin(phase / 2) + np.radians(3.0) * lively * _wander(rng, count, 0.8)
        return yaw + np.radians(self.glance_deg) * _glances(rng, count), roll, pitch


def _rounded_way(drive: Drive) -> Array:
    """(N, 4) x y yaw z of a drive, KNOTS a second, smoothed in time as a walker's steps do."""
    way = drive.at(np.arange(int(drive.duration * KNOTS) + 1) / KNOTS)
    return np.asarray(gaussian_filter1d(way, ROUNDED * KNOTS, axis=0, mode="nearest"))


def _wander(rng: np.random.Generator, count: int, time: float) -> Array:
    """(N,) a random curve of zero mean and unit variance, KNOTS a second, that changes within `time` seconds."""
    width = time / 2 * KNOTS
    margin = int(4 * width)
    smooth = gaussian_filter1d(rng.normal(size=count + 2 * margin), width)[margin : margin + count]
    return np.asarray(smooth * np.sqrt(2 * np.sqrt(np.pi) * width))


def _phase(count: int, rng: np.random.Generator) -> Array:
    """(N,) radians, one turn a step; steps are not all equally long."""
    rate = STEP_RATE * (1 + 0.04 * _wander(rng, count, 2.0))
    return np.asarray(rng.uniform(0, 4 * np.pi) + 2 * np.pi * np.cumsum(rate) / KNOTS)


def _glances(rng: np.random.Generator, count: int) -> Array:
    """(N,) looks to the side and back, every six seconds or so, half a second to a second and a half each."""
    t, swing = np.arange(count) / KNOTS, np.zeros(count)
    at = rng.exponential(6.0)
    while at < count / KNOTS:
        swing += rng.normal() * np.exp(-(((t - at) / rng.uniform(0.3, 0.9)) ** 2))
        at += 1.0 + rng.exponential(5.0)
    return swing


def _turned(offset: Array, yaw: Array) -> Array:
    """Offsets (N, 3) turned about z by yaw (N,)."""
    return np.column_stack([se2.rotate(yaw, offset[:, :2]), offset[:, 2]])


@dataclass(frozen=True, eq=False)
class Recorded(Carrier):
    """The motion of a recording, KNOTS a second, begun again where it ends.

    `attitude` (N, 4) are quaternions relative to the direction of the way, `offset` (N, 3) metres forward and left of
    it and up from `height`, and `speed` (N,) along it as a share of the usual one, which is `robot`'s.
    """

    attitude: Array
    offset: Array
    speed: Array

    @staticmethod
    def read(path: Path | str, pace: float = 1.0, reverse: bool = False) -> "Recorded":
        """Reads a TUM file: T_map_sensor with z upwards and metres above the floor. A person walks forward in a
        recording played from its end too: only its motions are reversed.

        `pace` plays it faster. Raises UserError if it is no trajectory, too short, or goes nowhere.
        """
        if not 0.1 <= pace <= 10:
            raise UserError(f"a pace of {pace:g} is out of range; give 0.1 to 10")
        rows = _resampled(Trajectory.read_tum(path), pace)
        if (len(rows) - 1) / KNOTS < SHORTEST:
            raise UserError(f"{path}: shorter than {SHORTEST:g} s; give a longer recording")
        way = gaussian_filter1d(rows[:, :3], SMOOTH * KNOTS, axis=0, mode="nearest")
        velocity = np.gradient(way[:, :2], axis=0) * KNOTS
        speed = np.linalg.norm(velocity, axis=1)
        moving = speed > STANDING
        if moving.mean() < 0.1:
            raise UserError(f"{path}: the sensor hardly moves; give a recording of a walk or drive")
        times = np.arange(len(rows))
        heading = np.unwrap(np.arctan2(velocity[moving, 1], velocity[moving, 0]))
        heading = np.interp(times, times[moving], heading)
        heading = gaussian_filter1d(heading, SMOOTH * KNOTS, mode="nearest")
        attitude = (Rotation.from_euler("z", -heading[:, None]) * Rotation.from_quat(rows[:, 3:])).as_quat()
        height, usual = float(np.median(rows[:, 2])), float(np.median(speed[moving]))
        beside = _turned(rows[:, :3] - way, -heading)[:, :2]
        parts = (attitude, np.column_stack([beside, rows[:, 2] - height]), speed / usual)
        attitude, offset, share = (_loop(part[::-1] if reverse else part) for part in parts)
        attitude /= np.linalg.norm(attitude, axis=1)[:, None]
        name = ", ".join([Path(path).name, *[f"pace {pace:g}"] * (pace != 1), *["reversed"] * reverse])
        robot = replace(PERSON, speed=usual, rest=0.0)
        return Recorded(name, robot, height, HANDHELD.top, HANDHELD.rolling, attitude, offset, share)

    def motion(self, drive: Drive, seed: int) -> Motion:
        """As in `Carrier`: `seed` says where in the recording it begins."""
        way = _rounded_way(drive)
        start = int(np.random.default_rng([seed, 32]).integers(len(self.speed)))
        played = np.tile(np.roll(np.arange(len(self.speed)), -start), int(np.ceil(len(way) / self.speed.sum())) + 1)
        speed = self.speed[played]
        along = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2)])
        played, along = played[along <= len(way) - 1], along[along <= len(way) - 1]
        way = CubicSpline(np.arange(len(way)), way)(along)
        attitude = Rotation.from_euler("z", way[:, 2:3]) * Rotation.from_quat(self.attitude[played])
        return self._moved(way, self.offset[played], attitude)


def _resampled(recording: Trajectory, pace: float) -> Array:
    """(N, 7) `x y z qx qy qz qw`, KNOTS a second, smoothly interpolated."""
    seconds = (recording.stamps_ns - recording.stamps_ns[0]) / 1e9 / pace
    if len(seconds) < 2:
        return np.empty((0, 7))
    rows = poses_to_xyzquat(recording.poses)
    rows[:, 3:] = continuous(rows[:, 3:])
    rows = CubicSpline(seconds, rows)(np.arange(int(seconds[-1] * KNOTS) + 1) / KNOTS)
    rows[:, 3:] /= np.linalg.norm(rows[:, 3:], axis=1)[:, None]
    return np.asarray(rows)


def _loop(values: Array) -> Array:
    """The values without the last SEAM seconds, which fade into the first ones."""
    count = int(SEAM * KNOTS)
    share = np.linspace(0.0, 1.0, count)
    weight = (share * share * (3 - 2 * share)).reshape(-1, *[1] * (values.ndim - 1))
    first, last = values[:count], values[-count:]
    if values.ndim == 2 and values.shape[1] == 4:
        last = np.where(np.sum(first * last, axis=1, keepdims=True) < 0, -last, last)
    return np.concatenate([weight * first + (1 - weight) * last, values[count:-count]])


WHEELED, HANDHELD = Carrier("wheeled", Robot(), height=0.8, top=1.6, rolling=False), Walker()
POLE = Walker(
    name="pole", height=1.9, top=1.95, bob=0.015, sway=0.01, tilt_deg=2.5, tilt_time=2.0, liveliness=0.4, rock_deg=0.4,
    glance_deg=10.0, lever=0.8,
)  # fmt: skip
CARRIERS: dict[str, Carrier] = {carrier.name: carrier for carrier in (WHEELED, HANDHELD, POLE)}


def carrier_named(name: str, pace: float = 1.0, reverse: bool = False) -> Carrier:
    """The carrier of this name, or the motion in this TUM file, at a factor of its pace, or played from its end.

    Raises UserError for what is neither, and for a pace of a carrier that is not recorded.
    """
    if name in CARRIERS:
        if pace != 1.0 or reverse:
            raise UserError(f"carrier {name} is not a recording: leave out pace and reversed")
        return CARRIERS[name]
    if Path(name).suffix != ".tum":
        raise UserError(f"carrier '{name}' is not known; give {', '.join(CARRIERS)}, or a trajectory FILE.tum")
    return Recorded.read(name, pace, reverse)
