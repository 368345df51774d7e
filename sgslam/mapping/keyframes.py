"""Keyframes: when one is taken, and what it remembers."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sgslam.config import KeyframeSettings
from sgslam.geometry.frames import inverse
from sgslam.perception.floor_extraction import FloorObservation
from sgslam.serialization.state_tree import Stateful

Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]  # of what there is much of


@dataclass
class KeyframeNode:
    """One keyframe of the S-graph; the back end moves `T_map_sensor`, the rest stays.

    `T_track_sensor` is the tracked motion summed up, which never jumps; only differences of it are used. `storey` is the
    number of the S-graph's floor that it was taken on, None on a stair. `step_covariance` is the covariance (6, 6) of the step to
    it beyond what every step has, rotation first, in the sensor's axes; None where surfaces held it all the way.
    """

    scan: int
    stamp_ns: int
    T_track_sensor: Floats
    T_map_sensor: Floats
    floor: FloorObservation | None = None
    outline: Floats32 = field(default_factory=lambda: np.empty((0, 3), np.float32))  # of free space, sensor frame
    lintels: Floats32 = field(default_factory=lambda: np.empty((0, 3), np.float32))  # sensor frame
    storey: int | None = 0
    step_covariance: Floats | None = None


class KeyframeRule(Stateful):
    """Takes a keyframe by distance, angle, or number of scans."""

    _STATE = ("_last", "_scans", "_stood")

    def __init__(self, settings: KeyframeSettings) -> None:
        self._settings = settings
        self._last: Floats | None = None
        self._scans = 0
        self._stood = 0  # keyframes in a row that were taken while standing still

    def wants(self, T_map_sensor: Floats) -> bool:
        """Whether the scan at this pose is to be a keyframe; the first always is."""
        self._scans += 1
        still = False
        if self._last is not None:
            step = inverse(self._last) @ T_map_sensor
            distance = float(np.linalg.norm(step[:3, 3]))
            angle = float(np.arccos(np.clip((np.trace(step[:3, :3]) - 1) / 2, -1.0, 1.0)))
            still = distance < 0.05 and angle < 0.05
            # each that is taken at one place tells less than the one before it: an hour's standing is not to be a map
            limit = self._settings.standing << self._stood if still else self._settings.scans
            if distance < self._settings.distance and angle < self._settings.angle and self._scans < limit:
                return False
        self._last, self._scans, self._stood = T_map_sensor, 0, self._stood + 1 if still else 0
        return True
