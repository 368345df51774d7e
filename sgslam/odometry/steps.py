"""Helpers of all rigid registrations: plausible steps, a search after lost tracking, and spacing of stored scans."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from sgslam.config import OdometrySettings
from sgslam.geometry.frames import inverse, squared_up

Floats = NDArray[np.float64]
# turns of a lost scan about each axis of the sensor, since its mount is not known; about z first
_TURNS = [
    Rotation.from_rotvec(np.radians(angle) * axis).as_matrix()
    for axis in np.eye(3)[::-1]
    for angle in (0, 30, -30, 60, -60, 90, -90, 120, -120, 150, -150, 180)
    if angle or axis[2]
]


def plausible(T_last_sensor: Floats, settings: OdometrySettings) -> bool:
    """Whether a step (4, 4) between two scans is plausible for a sensor carried through a building."""
    if not np.isfinite(T_last_sensor).all():
        return False
    moved = float(np.linalg.norm(T_last_sensor[:3, 3]))
    cosine = (np.trace(T_last_sensor[:3, :3]) - 1) / 2
    return bool(moved < settings.max_step and cosine > np.cos(settings.max_turn))


def search(
    source: Floats, last: Floats, tree: cKDTree, near: float, align: Callable[[Floats], Floats],
    settings: OdometrySettings,
) -> Floats | None:  # fmt: skip
    """The pose T_odom_sensor (4, 4) with the most points (N, 3), N >= 1, of the scan `near` (m) the map; None for too
    few.

    `align` registers the scan from the `last` pose rotated in steps of 30 degrees.
    """
    best, best_share = last, 0.0
    for turn in _TURNS:
        guess = last.copy()
        guess[:3, :3] = guess[:3, :3] @ turn
        pose = align(guess)
        step = inverse(last) @ pose
        if not np.linalg.norm(step[:3, 3]) <= settings.max_step:
            continue
        distance, _ = tree.query(source @ pose[:3, :3].T + pose[:3, 3], distance_upper_bound=near)
        share = float(np.mean(np.isfinite(distance)))
        if share > best_share + 0.02:
            best, best_share = pose, share
    return squared_up(best) if best_share >= settings.min_share else None


def far_apart(T_a: Floats, T_b: Floats, spacing: float) -> bool:
    """Whether two poses (4, 4) lie more than `spacing` apart, in metres or in radians."""
    since = inverse(T_a) @ T_b
    return bool(np.linalg.norm(since[:3, 3]) > spacing or np.trace(since[:3, :3]) < 1 + 2 * np.cos(spacing))
