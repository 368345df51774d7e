"""Deskews scans of a moving sensor to one instant."""

import gtsam
import numpy as np
from numpy.typing import ArrayLike, NDArray

from data.common.errors import UserError

Floats = NDArray[np.float64]


def deskewed(points: Floats, seconds: Floats, T_last_sensor: Floats, interval_s: float) -> Floats:
    """(N, 3) points in the sensor frame at one instant, from points measured `seconds` (N,) after it.

    The sensor is taken to move with the constant twist of its last step, `T_last_sensor` (4, 4) in `interval_s` seconds
    (as in KISS-ICP; Vizzo et al., RA-L 2023, III-A).
    """
    twist = np.asarray(gtsam.Pose3.Logmap(gtsam.Pose3(T_last_sensor))) / interval_s
    turn, move = twist[:3], twist[3:]
    rate = float(np.linalg.norm(turn))
    if rate < 1e-9:
        return points + seconds[:, None] * move
    # Exp(t twist) p in closed form (Rodrigues), for all t at once
    axis, angle = turn / rate, rate * seconds[:, None]
    across = np.cross(axis, points)
    sine, versine = np.sin(angle), 1 - np.cos(angle)
    turned = points + sine * across + versine * np.cross(axis, across)
    sideways = np.cross(axis, move)
    return np.asarray(
        turned + seconds[:, None] * move + versine / rate * sideways
        + (seconds[:, None] - sine / rate) * np.cross(axis, sideways)
    )  # fmt: skip


def part_of(step: Floats, share: float) -> Floats:
    """(4, 4) a share of a motion (4, 4), which may be negative or above one."""
    twist = np.asarray(gtsam.Pose3.Logmap(gtsam.Pose3(step)))
    return np.asarray(gtsam.Pose3.Expmap(share * twist).matrix())


def checked_times(point_times: ArrayLike, count: int, stamp_ns: int) -> Floats:
    """(N,) seconds after the stamp for each of `count` points; raises UserError for invalid times."""
    try:
        seconds = np.asarray(point_times, dtype=np.float64)
    except (TypeError, ValueError):
        seconds = np.empty(0)
    if seconds.shape != (count,) or not np.isfinite(seconds.sum()):
        raise UserError(f"scan at {stamp_ns} ns: point_times must be ({count},) finite seconds after the stamp")
    return seconds
