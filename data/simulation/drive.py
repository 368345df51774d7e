"""How a robot drives curves, with bounded acceleration, slower in bends, turning on the spot between them; and motions
of a sensor: along a drive, smooth through poses, shaken."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from data.geometry.poses import xyzquat_to_poses

Array = NDArray[np.float64]
Phase = tuple[float, Callable[[Array], Array]]  # its seconds, and x y yaw z (N, 4) of the ground at times (N,) in it
STEEP = 0.1  # m a metre: what is steeper is a stair
KNOTS = 50.0  # a second: well above what a hand does (its tremor ends at some 10 Hz)
LEAN = 0.15  # share of a stair's slope by which a robot's sensor tilts: it is carried nearly level
SHAKES = 1.5  # Hz
FADED = 0.5  # s in which the shaking begins and ends


@dataclass(frozen=True)
class Robot:
    """Metres, seconds, radians. `rest` is how long it stands before the first move and after the last; `stair_speed`
    is its speed over ground on stairs."""

    radius: float = 0.25
    speed: float = 0.8
    acceleration: float = 0.5
    yaw_rate: float = 0.8
    yaw_acceleration: float = 1.0
    rest: float = 0.5
    stair_speed: float = 0.4


@dataclass(frozen=True)
class Drive:
    """A drive of `duration` seconds from rest to rest; `at` gives x y yaw z (N, 4) of the ground at times (N,) that
    increase, clipped to the drive."""

    duration: float
    at: Callable[[Array], Array]


def plan_drive(legs: Sequence[Array], start_yaw: float, robot: Robot) -> Drive:
    """Drives legs (N, 3), x y z of the ground, each beginning where the one before ends; the robot's x axis points
    along the way. On stairs the robot is slower.
    """
    yaw = start_yaw
    phases = [_stand(legs[0][0], yaw, robot.rest)]
    for leg in legs:
        tangents = np.gradient(leg[:, :2], axis=0)
        headings = np.unwrap(np.arctan2(tangents[:, 1], tangents[:, 0]))
        turn = (headings[0] - yaw + np.pi) % (2 * np.pi) - np.pi
        headings += yaw + turn - headings[0]
        phases += [_turn(leg[0], yaw, turn, robot), _follow(leg, headings, robot)]
        yaw = float(headings[-1])
    phases.append(_stand(legs[-1][-1], yaw, robot.rest))
    durations = [duration for duration, _ in phases]
    ends = np.cumsum(durations)

    def at(seconds: Array) -> Array:
        seconds = np.clip(seconds, 0.0, ends[-1])
        phase = np.minimum(np.searchsorted(ends, seconds, side="right"), len(ends) - 1)
        return np.concatenate([phases[k][1](seconds[phase == k] - (ends - durations)[k]) for k in np.unique(phase)])

    return Drive(float(ends[-1]), at)


def _stand(place: Array, yaw: float, duration: float) -> Phase:
    return duration, lambda t: np.tile([*place[:2], yaw, place[2]], (len(t), 1))


def _turn(place: Array, yaw: float, angle: float, robot: Robot) -> Phase:
    """Turns on the spot: the yaw rate rises, stays, falls."""
    rate = min(robot.yaw_rate, float(np.sqrt(abs(angle) * robot.yaw_acceleration)))
    ramp = rate / robot.yaw_acceleration
    duration = ramp + abs(angle) / rate if rate > 0 else 0.0

    def at(t: Array) -> Array:
        rising, falling = np.minimum(t, ramp), np.maximum(t - (duration - ramp), 0)
        turned = rate * np.maximum(t - ramp, 0) + robot.yaw_acceleration / 2 * (rising**2 - falling**2)
        x, y, z = np.tile(place, (len(t), 1)).T
        return np.column_stack([x, y, yaw + np.sign(angle) * turned, z])

    return duration, at


def _follow(leg: Array, headings: Array, robot: Robot) -> Phase:
    """From rest to rest as fast as speed, yaw rate, and the accelerations of both allow."""
    steps = np.linalg.norm(np.diff(leg[:, :2], axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    curvature = np.gradient(headings, along)
    bending = np.abs(np.gradient(curvature, along))
    steep = np.abs(np.gradient(leg[:, 2], along)) > STEEP
    v = np.where(steep, min(robot.speed, robot.stair_speed), robot.speed)
    v = np.minimum(v, robot.yaw_rate / np.maximum(np.abs(curvature), 1e-9))
    v = np.minimum(v, np.sqrt(robot.yaw_acceleration / np.maximum(bending, 1e-9)))
    v[[0, -1]] = 0.0
    for i in range(1, len(v)):
        v[i] = min(v[i], np.sqrt(v[i - 1] ** 2 + 2 * robot.acceleration * steps[i - 1]))
    for i in range(len(v) - 2, -1, -1):
        v[i] = min(v[i], np.sqrt(v[i + 1] ** 2 + 2 * robot.acceleration * steps[i]))
    seconds = np.concatenate([[0.0], np.cumsum(2 * steps / (v[:-1] + v[1:]))])

    def at(t: Array) -> Array:
        i = np.clip(np.searchsorted(seconds, t, side="right") - 1, 0, len(steps) - 1)
        since = t - seconds[i]
        s = along[i] + v[i] * since + (v[i + 1] ** 2 - v[i] ** 2) / (4 * steps[i]) * since**2
        x, y, z = leg.T
        return np.column_stack([np.interp(s, along, c) for c in (x, y, headings, z)])

    return float(seconds[-1]), at


@dataclass(frozen=True)
class Motion:
    """A sensor's motion, `duration` seconds from rest to rest.

    At times (N,) that increase, `ground` gives x y yaw z (N, 4) of the way below, `poses` T_bim_sensor (N, 4, 4), with
    x forward along the way and z up unless the sensor is mounted otherwise.
    """

    duration: float
    ground: Callable[[Array], Array]
    poses: Callable[[Array], Array]

    def turned(self, R_of: Callable[[Array], Rotation]) -> "Motion":
        """The motion of a sensor that is turned in its place besides, by rotations at times (N,)."""

        def poses(seconds: Array) -> Array:
            T = self.poses(seconds)
            T[:, :3, :3] = T[:, :3, :3] @ R_of(seconds).as_matrix()
            return T

        return replace(self, poses=poses)

    def shaken(self, begin: float, lasts: float = 10.0, rate: float = 300.0) -> "Motion":
        """The sensor is turned to and fro, from `begin` on for `lasts` seconds, at up to `rate` degrees a second, about
        an axis that changes."""

        def swing(seconds: Array) -> Rotation:
            since = seconds - begin
            faded = np.clip(np.minimum(since, lasts - since) / FADED, 0.0, 1.0)
            phase = 2 * np.pi * SHAKES * since
            angle = np.radians(rate) / (2 * np.pi * SHAKES) * faded * faded * (3 - 2 * faded) * np.sin(phase)
            axes = np.column_stack([np.cos(0.7 * since), np.sin(0.7 * since), np.ones(len(since))])
            axes /= np.linalg.norm(axes, axis=1, keepdims=True)
            return Rotation.from_rotvec(angle[:, None] * axes)

        return self.turned(swing)


def level_motion(drive: Drive, height: float) -> Motion:
    """Exactly along the drive, `height` (m) above the ground."""

    def poses(seconds: Array) -> Array:
        ground = drive.at(seconds)
        T = np.tile(np.eye(4), (len(ground), 1, 1))
        c, s = np.cos(ground[:, 2]), np.sin(ground[:, 2])
        T[:, 0, 0], T[:, 0, 1], T[:, 1, 0], T[:, 1, 1] = c, -s, s, c
        T[:, :2, 3], T[:, 2, 3] = ground[:, :2], ground[:, 3] + height
        return T @ _nose_up(ground)

    return Motion(drive.duration, drive.at, poses)


def _nose_up(ground: Array) -> Array:
    """(N, 4, 4) the tilt on stairs."""
    moved = np.gradient(ground, axis=0) if len(ground) > 1 else np.zeros_like(ground)
    forward = np.linalg.norm(moved[:, :2], axis=1)
    up = LEAN * np.arctan2(np.where(forward > 1e-6, moved[:, 3], 0.0), np.maximum(forward, 1e-6))
    T = np.tile(np.eye(4), (len(ground), 1, 1))
    T[:, 0, 0], T[:, 0, 2] = np.cos(up), -np.sin(up)
    T[:, 2, 0], T[:, 2, 2] = np.sin(up), np.cos(up)
    return T


def smooth_motion(xyzquat: Array, way: Array) -> Motion:
    """Through poses `xyzquat` (N, 7) at KNOTS a second, twice continuously differentiable, over the ground `way`
    (N, 4)."""
    knots, quaternions = np.arange(len(xyzquat)) / KNOTS, xyzquat[:, 3:]
    spline = CubicSpline(knots, np.column_stack([xyzquat[:, :3], continuous(quaternions)]))

    def ground(seconds: Array) -> Array:
        return np.column_stack([np.interp(seconds, knots, column) for column in way.T])

    def poses(seconds: Array) -> Array:
        return xyzquat_to_poses(spline(np.clip(seconds, 0.0, knots[-1])))

    return Motion(float(knots[-1]), ground, poses)


def continuous(quaternions: Array) -> Array:
    """Quaternions (N, 4) with signs that do not jump from one to the next."""
    dots = np.sum(quaternions[1:] * quaternions[:-1], axis=1)
    signs = np.cumprod(np.concatenate([[1.0], np.where(dots < 0, -1.0, 1.0)]))
    return np.asarray(signs[:, None] * quaternions)
