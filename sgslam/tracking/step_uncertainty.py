"""Step uncertainty: how well surfaces constrain the steps between keyframes in each direction.

In a bare corridor nothing constrains the motion along it; in an open hall nothing constrains it at all.
"""

import math

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sgslam.config import OdometrySettings, TrackingSettings
from sgslam.serialization import Stateful

Floats = NDArray[np.float64]
_EVERY = 2  # of the points; the others are redundant
_CELL = 0.15  # m: the noise of a point is a small part of it
_NEIGHBOURS = 5  # cells that make a piece of a surface
_NEAR = 0.6  # m to the furthest of them
_MOST = 200.0  # points that a scan counts for at most: neighbours share their errors
_CHANCE = 0.003  # of the points: constraint along parallel walls that errors of the normals feign
_DOUBLED = 2.0  # variance relative to that of a default step, from which on a step gets a covariance of its own


def surfaces_of(points: Floats) -> Floats:
    """(3, 3) information of yaw, x and y (sensor axes) that points (N, 3) on upright surfaces give.

    Point to plane: each point counts one across its surface and nothing along it. The eigenvalues show degenerate
    directions (Zhang, Kaess, Singh, ICRA 2016). The sensor is roughly level.
    """
    xy = points[::_EVERY, :2]
    if len(xy) < _NEIGHBOURS:
        return np.zeros((3, 3))
    row, column = np.floor((xy - xy.min(axis=0)) / _CELL).astype(np.int64).T
    # one number for each cell: sorting pairs is many times slower
    _, cell, count = np.unique(row * (column.max() + 1) + column, return_inverse=True, return_counts=True)
    if len(count) < _NEIGHBOURS:
        return np.zeros((3, 3))
    centre = np.stack([np.bincount(cell, xy[:, axis]) for axis in (0, 1)], axis=1) / count[:, None]
    distance, nearest = cKDTree(centre).query(centre, _NEIGHBOURS)
    around = centre[nearest] - centre[nearest].mean(axis=1, keepdims=True)
    spread, axes = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around))
    normal = axes[:, :, 0]
    # clutter has no normal; a surface is at least four times as long as wide
    straight = (distance[:, -1] < _NEAR) & (spread[:, 0] < spread[:, 1] / 16)
    centre, normal = centre[straight], normal[straight]
    weight = count[straight] * min(1.0, _MOST / max(count[straight].sum(), 1.0))
    J = np.column_stack([centre[:, 0] * normal[:, 1] - centre[:, 1] * normal[:, 0], normal])
    return np.asarray(J.T @ (J * weight[:, None]))


def turned(information: Floats, T_level_sensor: Floats) -> Floats:
    """(3, 3) information of yaw, x and y turned from the sensor's axes to level axes."""
    D = np.eye(3)
    D[1:, 1:] = T_level_sensor[:2, :2]
    return np.asarray(D @ information @ D.T)


class StepUncertainty(Stateful):
    """Covariance (3, 3) of yaw, x and y (level axes) of the tracked motion since the last keyframe.

    A Kalman filter: each scan's step adds its uncertainty, its surfaces reduce it. Roll, pitch and height are
    constrained by the floor and by how the sensor is carried.

    Where nothing constrains it, a registration locks onto the scan's own rings, scan after scan: the errors of its
    steps add up linearly, not as squares.
    """

    _STATE = ("_covariance", "_scans")

    def __init__(self, odometry: OdometrySettings, tracking: TrackingSettings) -> None:
        self._base = np.diag([odometry.sigma_rotation] + [odometry.sigma_translation] * 2)
        self._point = tracking.sigma_point
        self._covariance, self._scans = np.zeros((3, 3)), 0

    def add(self, information: Floats, sigma_rotation: float, sigma_translation: float) -> None:
        """Adds a scan whose step has the sigmas (rad, m); `information` (3, 3) is that of its surfaces."""
        self._scans += 1
        step = np.diag([sigma_rotation**2] + [sigma_translation**2] * 2)
        wider = self._covariance + (2 * self._scans - 1) * step  # n^2 of it after n scans
        (a, b), (_, c) = information[1:, 1:].tolist()
        mean, reach = (a + c) / 2, math.hypot((a - c) / 2, b)  # the eigenvalues are mean -+ reach
        if mean - reach < _CHANCE * (mean + reach):
            S = np.eye(3)
            _, axes = np.linalg.eigh(information[1:, 1:])
            S[1:, 1:] = np.outer(axes[:, 1], axes[:, 1])
            information = S @ information @ S
        covariance = np.linalg.solve(np.eye(3) + wider @ information / self._point**2, wider)
        self._covariance = (covariance + covariance.T) / 2

    def leave(self, R_level_sensor: Floats) -> Floats | None:
        """Restarts from a keyframe; returns the covariance (6, 6) of the step to it in excess of the default.

        Rotation first, in the sensor's axes; None where there is no excess worth a factor.
        """
        covariance, self._covariance, self._scans = self._covariance, np.zeros((3, 3)), 0
        whitener = np.linalg.inv(self._base)
        variances, axes = np.linalg.eigh(whitener @ covariance @ whitener)
        if variances[-1] < _DOUBLED:
            return None
        root = self._base @ axes * np.sqrt(np.maximum(variances - 1.0, 0.0))
        M = np.zeros((6, 3))
        M[:3, 0], M[3:, 1:] = R_level_sensor[2], R_level_sensor[:2].T
        return np.asarray((M @ root) @ (M @ root).T)
