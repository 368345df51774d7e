"""Where up is, by the accelerometer of a moving sensor."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from data.imu.samples import GRAVITY, unit_of_forces
from sgslam.inertial.buffer import ImuBuffer

Floats = NDArray[np.float64]
_SHORTEST_NS = 900_000_000  # over a shorter time the carrier's steps outweigh gravity
_PLACE = 0.03  # m, standard deviation of places by registration
_WRONG = 0.2  # share by which the found gravity may differ from the true one; more, and the places are wrong


def measured_up(imu: ImuBuffer, stamps_ns: NDArray[np.int64], poses: Floats, speed: float) -> Floats | None:
    """(3,) the unit vector upwards in the frame of the poses (N, 4, 4) of the sensor at stamps (N,). The standard
    deviation of the first velocity is `speed` (m/s).

    Twice integrated, the specific force is the way from the first place, less that by the first velocity, and by
    gravity: both are found by least squares. None where samples are missing or far from gravity, in m/s2 as in g, or
    the time is too short.
    """
    if len(stamps_ns) < 2 or stamps_ns[-1] - stamps_ns[0] < _SHORTEST_NS:
        return None
    samples = imu.around(int(stamps_ns[0]), int(stamps_ns[-1]))
    unit = None if samples is None else unit_of_forces(samples.accel)
    if samples is None or unit is None:
        return None
    at, seconds = (samples.stamps_ns - stamps_ns[0]) / 1e9, (stamps_ns - stamps_ns[0]) / 1e9
    attitudes = Slerp(seconds, Rotation.from_matrix(poses[:, :3, :3]))(np.clip(at, 0.0, seconds[-1]))
    forces = attitudes.apply(unit * samples.accel)
    usual = forces.mean(axis=0)
    ways = poses[1:, :3, 3] - poses[0, :3, 3] - _twice_integrated(at, forces, seconds)[1:]
    t = seconds[1:, None]
    rows = np.concatenate([np.hstack([t, -(t**2) / 2]) / _PLACE, [[1 / speed, 0.0]]])
    _, gravity = np.linalg.lstsq(rows, np.concatenate([ways / _PLACE, np.zeros((1, 3))]), rcond=None)[0]
    found = gravity if abs(np.linalg.norm(gravity) / GRAVITY - 1) < _WRONG else usual
    return np.asarray(found / np.linalg.norm(found))


def _twice_integrated(at: Floats, forces: Floats, seconds: Floats) -> Floats:
    """(N, 3) the ways at `seconds` (N,) of a body that begins at rest, with accelerations (M, 3) at times (M,)."""
    steps = np.diff(at, prepend=at[0])[:, None]
    velocities = np.cumsum((forces + np.roll(forces, 1, axis=0)) / 2 * steps, axis=0)
    ways = np.cumsum((velocities + np.roll(velocities, 1, axis=0)) / 2 * steps, axis=0)
    return np.column_stack([np.interp(seconds, at, column) for column in ways.T])
