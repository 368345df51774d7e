"""Parts of the system replaced for an experiment: a matcher that knows the truth, and a front end that drifts."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.scans import Scan
from data.scene_graph import SceneGraph
from data.trajectory import Trajectory
from evaluation.metrics.trajectories import ape
from evaluation.metrics.true_matches import true_matches
from matching import Hypothesis, MatchResult

Array = NDArray[np.float64]
LEAST_WALLS = 4
RANGE_M = 6.0  # of a weakened sensor; a level one at 0.8 m needs 3 m to see the floor
SCALE, YAW_RAD = 0.01, float(np.radians(0.3))  # at level 1: relative step error; yaw random walk per sqrt(m)
LEAST_ERROR_M, MOST_LEVEL = 0.5, 64


class OracleMatcher:
    """Returns the true matches, from the true T_bim_map (4, 4)."""

    def __init__(self, T_bim_map: Array, floor: str | None) -> None:
        self._T, self._floor = T_bim_map, floor

    def match(self, s: SceneGraph, a: SceneGraph) -> MatchResult:
        """The true match of an S-graph; status `none` with too few walls."""
        truth = true_matches(s, a.on_floor(self._floor), self._T)
        if len(truth.wall_surfaces) < LEAST_WALLS:
            return MatchResult("none", f"fewer than {LEAST_WALLS} true matches so far")
        rooms = tuple((s_id, a_id, 1.0) for s_id, a_id in truth.rooms.items())
        walls = tuple((s_id, a_id, 1.0) for s_id, a_id in truth.wall_surfaces.items())
        sole = Hypothesis(0.0, truth.T_a_s, self._floor, tuple(truth.rooms.items()))
        return MatchResult("unique", "the truth was given", rooms, walls, truth.T_a_s, self._floor, (sole,))


def within_range(scans: Iterator[Scan]) -> Iterator[Scan]:
    """The scans without their points beyond `RANGE_M`; with the nearest 50 if fewer remain."""
    for scan in scans:
        ranges = np.linalg.norm(scan.points, axis=1)
        near = np.flatnonzero(ranges < RANGE_M)
        near = near if len(near) >= 50 else np.argsort(ranges)[:50]
        times = None if scan.point_times is None else scan.point_times[near]
        yield replace(scan, points=scan.points[near], point_times=times)


def weakened(odometry: Trajectory, truth: Trajectory, seed: int) -> Trajectory:
    """Degrades T_odom_sensor of all scans, doubling the level from 1 until its RMSE (m, first poses aligned) exceeds
    0.5 m.

    A run takes the poses of an external odometry as they are. At level k each step is k % too long and the heading has
    a random walk of 0.3 k degrees per square root of a metre. Raises UserError if no level is enough.
    """
    level = 1
    while level <= MOST_LEVEL:
        worse = Trajectory(odometry.stamps_ns, _worsened(odometry.poses, level, seed))
        if ape(worse, truth, "origin").translation.rmse > LEAST_ERROR_M:
            return worse
        level *= 2
    raise UserError(f"weakened: the drive is too short for an odometry error of {LEAST_ERROR_M} m; take a longer one")


def _worsened(poses: Array, level: int, seed: int) -> Array:
    """(N, 4, 4) the poses with the step errors of a level."""
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
