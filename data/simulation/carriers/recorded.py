"""A recorded motion of a sensor, put along another way: its attitude, height and speed, not its place."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from data.common.errors import UserError
from data.geometry.poses import poses_to_xyzquat
from data.simulation.carriers.carrier import KNOTS, WHEELED, Array, Carrier, SmoothMotion, bounded, rounded_way
from data.simulation.carriers.walking import HANDHELD, NEAREST, PERSON, POLE, turned
from data.simulation.drive import Drive
from data.trajectory import Trajectory

SMOOTH = 0.5  # s: the way is what is left of the recorded places after this
STANDING = 0.3  # m/s: below, the direction of the way is not known
SEAM = 1.0  # s over which the recording's end fades into its beginning
SHORTEST = 5.0  # s


@dataclass(frozen=True, eq=False)
class Recorded(Carrier):
    """The motion of a recording, KNOTS a second, begun again where it ends.

    `attitude` (N, 4) are quaternions relative to the direction of the way, `offset` (N, 2) metres forward and left of
    it, `rise` (N,) metres from `height`, and `speed` (N,) along it as a share of the usual one, which is `robot`'s.
    """

    attitude: Array
    offset: Array
    rise: Array
    speed: Array

    @staticmethod
    def read(path: Path | str, pace: float = 1.0, reverse: bool = False) -> "Recorded":
        """Reads a TUM file: T_map_sensor with z upwards and metres above the floor.

        `pace` plays it faster. Raises UserError if it is no trajectory, too short, or goes nowhere.
        """
        if not 0.1 <= pace <= 10:
            raise UserError(f"a pace of {pace:g} is out of range; give 0.1 to 10")
        recording = Trajectory.read_tum(path)
        rows = _resampled(recording, pace)
        if (len(rows) - 1) / KNOTS < SHORTEST:
            raise UserError(f"{path}: shorter than {SHORTEST:g} s; give a longer recording")
        how = [f"pace {pace:g}"] * (pace != 1) + ["reversed"] * reverse
        name = ", ".join([Path(path).name, *how])
        return _along_its_way(rows, reverse, name, path)

    def motion(self, drive: Drive, level: float, seed: int) -> SmoothMotion:
        """As in `Carrier`: `seed` says where in the recording it begins."""
        way = rounded_way(drive, level)
        start = int(np.random.default_rng([seed, 32]).integers(len(self.speed)))
        played = np.tile(np.roll(np.arange(len(self.speed)), -start), int(np.ceil(len(way) / self.speed.sum())) + 1)
        speed = self.speed[played]
        along = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2)])
        played, along = played[along <= len(way) - 1], along[along <= len(way) - 1]
        way = CubicSpline(np.arange(len(way)), way)(along)
        attitude = Rotation.from_euler("z", way[:, 2:3]) * Rotation.from_quat(self.attitude[played])
        offset = np.column_stack([bounded(self.offset[played], self.robot.radius - NEAREST), self.rise[played]])
        places = np.column_stack([way[:, :2], way[:, 3] + self.height]) + turned(offset, way[:, 2])
        return SmoothMotion(np.column_stack([places, attitude.as_quat()]), way)


def _resampled(recording: Trajectory, pace: float) -> Array:
    """(N, 7) `x y z qx qy qz qw`, KNOTS a second, smoothly interpolated."""
    seconds = (recording.stamps_ns - recording.stamps_ns[0]) / 1e9 / pace
    if len(seconds) < 2:
        return np.empty((0, 7))
    rows = poses_to_xyzquat(recording.poses)
    signs = np.cumprod(np.where(np.sum(rows[1:, 3:] * rows[:-1, 3:], axis=1) < 0, -1.0, 1.0))
    rows[1:, 3:] *= signs[:, None]
    rows = CubicSpline(seconds, rows)(np.arange(int(seconds[-1] * KNOTS) + 1) / KNOTS)
    rows[:, 3:] /= np.linalg.norm(rows[:, 3:], axis=1)[:, None]
    return np.asarray(rows)


def _along_its_way(rows: Array, reverse: bool, name: str, path: Path | str) -> Recorded:
    """The person walks forward in a recording played from its end too: only its motions are reversed."""
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
    beside = turned(rows[:, :3] - way, -heading)[:, :2]
    height = float(np.median(rows[:, 2]))
    usual = float(np.median(speed[moving]))
    parts = (attitude, beside, rows[:, 2] - height, speed / usual)
    attitude, beside, rise, share = (_loop(part[::-1] if reverse else part) for part in parts)
    attitude /= np.linalg.norm(attitude, axis=1)[:, None]
    robot = replace(PERSON, speed=usual, rest=0.0)
    return Recorded(name, robot, height, HANDHELD.top, HANDHELD.rolling, attitude, beside, rise, share)


def _loop(values: Array) -> Array:
    """The values without the last SEAM seconds, which fade into the first ones."""
    count = int(SEAM * KNOTS)
    share = np.linspace(0.0, 1.0, count)
    weight = (share * share * (3 - 2 * share)).reshape(-1, *[1] * (values.ndim - 1))
    first, last = values[:count], values[-count:]
    if values.ndim == 2 and values.shape[1] == 4:
        last = np.where(np.sum(first * last, axis=1, keepdims=True) < 0, -last, last)
    return np.concatenate([weight * first + (1 - weight) * last, values[count:-count]])


CARRIERS: dict[str, Carrier] = {"wheeled": WHEELED, "handheld": HANDHELD, "pole": POLE}


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
