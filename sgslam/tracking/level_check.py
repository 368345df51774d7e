"""Looks once more, after half a minute, whether the frame `odom` is level."""

import logging
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sgslam.config import TrackingSettings
from sgslam.serialization import Stateful
from sgslam.surfels import SurfelMap
from sgslam.tracking.gravity import estimate_gravity
from sgslam.tracking.level_frame import SIDE, add_scan

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
_UP = np.array([0.0, 0.0, 1.0])
_AFTER_S = 30.0  # of walking through several rooms: they tell more than the first seconds
_BETWEEN_NS = 400_000_000  # from a scan that is looked at to the next: a step or two on the way, or a turn of the head
_OFF = np.radians(10.0)  # right frames are level to a degree; farther off, another direction was taken for up


class LevelCheck(Stateful):
    """Collects the surfaces of the first half minute, and warns if they contradict the level frame.

    Nothing is changed then: the map is built in that frame. Which end is up is not doubted here: hanging sensors are
    rare, and surfaces that look upside down are not.
    """

    _STATE = ("_began_ns", "_next_ns", "_places", "_is_done")

    def __init__(self, settings: TrackingSettings) -> None:
        self._settings = settings
        self._surfels = SurfelMap()
        self._places: list[Floats] = []
        self._began_ns: int | None = None
        self._next_ns = 0
        self._is_done = False

    def add(self, stamp_ns: int, points: Floats, T_odom_sensor: Floats) -> None:
        """Adds a scan with points (N, 3) as at its stamp and its pose (4, 4) in the level frame, if it is its turn."""
        if self._is_done or stamp_ns < self._next_ns:
            return
        self._began_ns = stamp_ns if self._began_ns is None else self._began_ns
        self._next_ns = stamp_ns + _BETWEEN_NS
        add_scan(self._surfels, points, T_odom_sensor, SIDE, self._settings)
        self._places.append(T_odom_sensor[:3, 3])
        if stamp_ns - self._began_ns >= 1e9 * _AFTER_S:
            self._check()
            self._surfels.clear()
            self._places, self._is_done = [], True

    def _check(self) -> None:
        found = estimate_gravity(*self._surfels.surfels(), np.stack(self._places), _UP)
        if found is None or not found.axis_sure:
            return
        off = float(np.degrees(np.arccos(np.clip(abs(found.up_in_odom[2]), -1.0, 1.0))))
        if np.radians(off) > _OFF:
            _log.warning(
                "the map is not level: later scans show the vertical %.0f degrees off that of the first seconds; "
                "give roll, pitch and yaw of the sensor with --mount", off,
            )  # fmt: skip

    def state(self) -> dict[str, Any]:
        """See `Stateful`; with the surfaces."""
        return {**super().state(), "surfels": self._surfels.state()}

    def restore(self, state: dict[str, Any]) -> None:
        """See `Stateful`."""
        super().restore(state)
        self._surfels.restore(state["surfels"])
