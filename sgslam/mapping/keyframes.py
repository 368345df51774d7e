"""Keyframes: their data, and the rule that takes one."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sgslam.config import KeyframeSettings, OdometrySettings
from sgslam.geometry.frames import inverse

Floats = NDArray[np.float64]
SMOOTHED = 0.6  # times a step's standard deviations after a second pass; measured 0.4 to 0.9 in 16 drives
_STANDING = 50  # scans from keyframe to keyframe while the sensor stands; doubled after each
Floats32 = NDArray[np.float32]  # of what there is much of


@dataclass
class KeyframeNode:
    """One keyframe of the S-graph; the back end updates `T_map_sensor` (4, 4), the rest does not change.

    `T_track_sensor` (4, 4) accumulates the tracked motion and never jumps; only differences of it are used. `storey` is
    the number of the S-graph's floor that it was taken on, None on a stair. `step_covariance` (6, 6), rotation first,
    sensor axes, is that of the tracked step to it; `weak_step`: surfaces left some direction of it unconstrained;
    `smoothed`: a second pass has estimated it again. The surfaces show the vertical `up` (3,), in the sensor
    frame, with a standard deviation `sigma_up`.
    """

    scan: int
    stamp_ns: int
    T_track_sensor: Floats
    T_map_sensor: Floats
    outline: Floats32 = field(default_factory=lambda: np.empty((0, 3), np.float32))  # of free space, sensor frame
    lintels: Floats32 = field(default_factory=lambda: np.empty((0, 3), np.float32))  # sensor frame
    storey: int | None = 0
    step_covariance: Floats = field(default_factory=lambda: _default_step(OdometrySettings()))
    weak_step: bool = False
    smoothed: bool = False
    up: Floats = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))
    sigma_up: float = np.inf  # rad


def _default_step(settings: OdometrySettings) -> Floats:
    return np.diag(np.repeat([settings.sigma_rotation, settings.sigma_translation], 3) ** 2)


class KeyframeRule:
    """Takes a keyframe by distance, angle, or number of scans."""

    def __init__(self, settings: KeyframeSettings) -> None:
        self._settings = settings
        self._last: Floats | None = None
        self._scans = 0
        self._stood = 0  # consecutive keyframes taken while standing still

    def offer(self, T_map_sensor: Floats) -> bool:
        """Offers the scan at this pose (4, 4); returns whether it becomes a keyframe. The first always does."""
        self._scans += 1
        still = False
        if self._last is not None:
            step = inverse(self._last) @ T_map_sensor
            distance = float(np.linalg.norm(step[:3, 3]))
            angle = float(np.arccos(np.clip((np.trace(step[:3, :3]) - 1) / 2, -1.0, 1.0)))
            still = distance < 0.05 and angle < 0.05
            # further keyframes at one place add little: an hour of standing still must not fill the map
            limit = _STANDING << self._stood if still else self._settings.scans
            if distance < self._settings.distance and angle < self._settings.angle and self._scans < limit:
                return False
        self._last, self._scans, self._stood = T_map_sensor, 0, self._stood + 1 if still else 0
        return True
