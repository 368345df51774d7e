"""Finds where a lost sensor is in a local map, within reach of where it was lost: poses are scored on a grid."""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from data.common.compiled import compiled
from sgslam.geometry.frames import levelling
from sgslam.surfels.search import Surfels, nearest_plane

Floats = NDArray[np.float64]

_MOST = 300  # points that are compared for each pose
_OFF = 0.4  # m: a point of a pose half a grid step away is this far from its surface
_YAW, _TILT = np.radians(15.0), np.radians(20.0)  # rad, steps of the grid
_STEP, _REACH = 0.5, 1.0  # m, step and half width of the grid
_TILTS = _TILT * np.array([(0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)])


def likely_poses(
    points: Floats, T_near: Floats, up: Floats, surfels: Surfels, oldest: float, count: int
) -> list[Floats]:
    """The `count` best poses T_odom_sensor (4, 4) of a sensor that saw points (N, 6), with the normals of their
    surfaces.

    It is about `T_near` (4, 4): a metre away at most, tilted by 20 degrees at most, with any heading about `up` (3,).
    """
    own = points[np.random.default_rng(0).permutation(len(points))[:_MOST]]
    levelled = levelling(up)  # rows: two level directions, and up
    steps = np.arange(-_REACH, _REACH + _STEP / 2, _STEP)
    shifts = np.array([[x, y] for x in steps for y in steps]) @ levelled[:2]
    yaws = Rotation.from_rotvec(np.arange(0, 2 * np.pi - _YAW / 2, _YAW)[:, None] * up)
    tilts = Rotation.from_rotvec(_TILTS @ levelled[:2])
    turns = np.stack([yaw.as_matrix() @ tilt.as_matrix() for yaw in yaws for tilt in tilts])
    poses = np.tile(np.eye(4), (len(turns), len(shifts), 1, 1))
    poses[:, :, :3, :3] = (turns @ T_near[:3, :3])[:, None]
    poses[:, :, :3, 3] = T_near[:3, 3] + shifts
    poses = poses.reshape(-1, 4, 4)
    scores = _scores(poses, own, surfels, oldest)
    return list(poses[np.argsort(-scores, kind="stable")[:count]])


@compiled
def _scores(poses: Floats, points: Floats, surfels: Surfels, oldest: float) -> Floats:
    """How many points have a plane in reach, for each pose (P, 4, 4)."""
    scores = np.zeros(len(poses))
    for n in range(len(poses)):
        T = poses[n]
        for p in range(len(points)):
            q = points[p]
            point = (
                T[0, 0] * q[0] + T[0, 1] * q[1] + T[0, 2] * q[2] + T[0, 3],
                T[1, 0] * q[0] + T[1, 1] * q[1] + T[1, 2] * q[2] + T[1, 3],
                T[2, 0] * q[0] + T[2, 1] * q[1] + T[2, 2] * q[2] + T[2, 3],
            )
            normal = (
                T[0, 0] * q[3] + T[0, 1] * q[4] + T[0, 2] * q[5],
                T[1, 0] * q[3] + T[1, 1] * q[4] + T[1, 2] * q[5],
                T[2, 0] * q[3] + T[2, 1] * q[4] + T[2, 2] * q[5],
            )
            sensor = (T[0, 3], T[1, 3], T[2, 3])
            scores[n] += nearest_plane(point, sensor, normal, _OFF, _OFF, surfels, oldest) > 0
    return scores
