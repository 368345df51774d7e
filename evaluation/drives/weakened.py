"""A front end degraded in a known way, so that a map without the plan drifts.

A run takes the poses that an external odometry gives as they are, and registers nothing itself. What else would remove
their drift are loops and large structures, which a long-range LiDAR sees from far. Therefore both are degraded: the
odometry and the range of the scans.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.trajectory import Trajectory
from evaluation.metrics.trajectories import ape

Array = NDArray[np.float64]
RANGE_M = 6.0  # points beyond are dropped; a level sensor at 0.8 m needs 3 m to see the floor
SCALE, YAW_RAD = 0.01, float(np.radians(0.3))  # at level 1: relative step error; yaw random walk per sqrt(m)
LEAST_ERROR_M = 0.5
MOST_LEVEL = 64


@dataclass(frozen=True, eq=False)
class WeakOdometry:
    """A degraded odometry: T_odom_sensor of all scans, its `level`, and its RMSE with the first poses aligned."""

    trajectory: Trajectory
    level: int
    rmse_m: float

    def describe(self) -> str:
        """A one-line description for the table."""
        return (
            f"points beyond {RANGE_M:g} m dropped; odometry: steps {100 * SCALE * self.level:g} % too long, yaw random "
            f"walk {np.degrees(YAW_RAD) * self.level:.1f} deg per sqrt(m); its RMSE {self.rmse_m:.2f} m"
        )


def weaken_odometry(odometry: Trajectory, truth: Trajectory, seed: int) -> WeakOdometry:
    """Degrades an odometry, doubling the level from 1 until its RMSE exceeds 0.5 m.

    At level k each step is k % too long and the heading has a random walk of 0.3 k degrees per square root of a metre.
    Raises UserError if no level is enough (a robot that hardly moves).
    """
    level = 1
    while level <= MOST_LEVEL:
        worse = Trajectory(odometry.stamps_ns, worsened(odometry.poses, level, seed))
        rmse = ape(worse, truth, "origin").translation.rmse
        if rmse > LEAST_ERROR_M:
            return WeakOdometry(worse, level, rmse)
        level *= 2
    raise UserError(f"--weaken: the drive is too short for an odometry error of {LEAST_ERROR_M} m; take a longer one")


def within_range(points: Array) -> NDArray[np.intp]:
    """The indices of the points (N, 3), sensor frame, within the reduced range; the nearest 50 if there are fewer."""
    ranges = np.linalg.norm(points, axis=1)
    near = np.flatnonzero(ranges < RANGE_M)
    return near if len(near) >= 50 else np.argsort(ranges)[:50]


def shortened(points: Array) -> Array:
    """The points (N, 3) that `within_range` selects."""
    return np.asarray(points[within_range(points)])


def worsened(poses: Array, level: int, seed: int) -> Array:
    """(N, 4, 4) the poses with the step errors of `weaken_odometry` at a level."""
    steps = np.linalg.inv(poses[:-1]) @ poses[1:]
    lengths = np.linalg.norm(steps[:, :3, 3], axis=1)
    yaw = level * YAW_RAD * np.sqrt(lengths) * np.random.default_rng([seed, 7]).standard_normal(len(lengths))
    turn = np.tile(np.eye(4), (len(steps), 1, 1))
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(yaw)
    turn[:, 1, 0] = np.sin(yaw)
    turn[:, 0, 1] = -turn[:, 1, 0]
    steps[:, :3, 3] *= 1 + level * SCALE
    worse = [poses[0]]
    for step in steps @ turn:
        worse.append(worse[-1] @ step)
    return np.array(worse)
