"""Finds where up is, from the surfaces of the first seconds: the mount is not known, and a hand is never level."""

import logging

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sgslam.config import TrackingSettings
from sgslam.geometry.frames import levelling
from sgslam.registration import SurfelMap
from sgslam.registration.sampling import one_a_cell
from sgslam.serialization import Stateful
from sgslam.tracking.gravity import Gravity, estimate_gravity

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
_SIDE = 0.1  # m between the points of a scan that are used
_BETWEEN_NS = 1_000_000_000  # between two attempts


class LevelFrame(Stateful):
    """`T_level_first` (4, 4) turns the frame of the first pose upright; `known` once that is settled.

    Until then `likely_up` (3,) is the best answer so far, in that frame.
    """

    _STATE = ("known", "likely_up", "_began_ns", "_next_ns", "_points", "_poses")

    def __init__(self, settings: TrackingSettings) -> None:
        self._settings = settings
        roll, pitch, yaw = settings.mount or (0.0, 0.0, 0.0)
        # up in the first sensor's axes, if the carrier stands upright
        self._expected: Floats = Rotation.from_euler("ZYX", (yaw, pitch, roll), degrees=True).as_matrix()[2]
        self.likely_up = self._expected
        self.known = False
        self._began_ns: int | None = None
        self._next_ns = 0
        self._points: list[Floats] = []  # (N, 3) of each scan, sensor frame
        self._poses: list[Floats] = []  # of each scan, (4, 4)

    @property
    def T_level_first(self) -> Floats:  # noqa: N802
        """(4, 4) with the first pose's place and heading."""
        T = np.eye(4)
        T[:3, :3] = levelling(self.likely_up)
        return T

    def add(self, stamp_ns: int, points: Floats, T_first_sensor: Floats) -> None:
        """Adds a scan (N, 3) and looks for gravity when it is time."""
        settings = self._settings
        if self._began_ns is None:
            self._began_ns, self._next_ns = stamp_ns, stamp_ns + _BETWEEN_NS
        chosen = one_a_cell(points, _SIDE, settings.min_range, settings.max_range)
        self._points.append(points.take(chosen, axis=0))
        self._poses.append(T_first_sensor)
        if stamp_ns < self._next_ns:
            return
        self._next_ns = stamp_ns + _BETWEEN_NS
        waited_s = (stamp_ns - self._began_ns) / 1e9
        found = self._estimate()
        if waited_s >= settings.gravity_until:
            self._settle(found)
        elif found is not None:
            self.likely_up = found.up_in_odom
            if waited_s >= settings.gravity_after and found.sign_sure:
                self._settle(found)

    def settle(self) -> None:
        """Ends the search: where nothing was found, up is where the mount says."""
        if not self.known:
            self._settle(self._estimate() if self._points else None)

    def _estimate(self) -> Gravity | None:
        """What the surfaces of all scans tell."""
        surfels = SurfelMap()
        for points, T in zip(self._points, self._poses, strict=True):
            turned = points @ T[:3, :3].T
            rays = turned / np.linalg.norm(turned, axis=1, keepdims=True)
            surfels.add(turned + T[:3, 3], rays, 0.0, 1.0)
        places = np.stack([T[:3, 3] for T in self._poses])
        return estimate_gravity(*surfels.surfels(), places, self._expected)

    def _settle(self, found: Gravity | None) -> None:
        """Takes what was found, and warns where it is not sure."""
        settings, up = self._settings, self._expected if found is None else found.up_in_odom
        tilt = float(np.arccos(np.clip(up @ self._expected, -1.0, 1.0)))
        if found is None:
            _log.warning(
                "the surfaces of the first seconds do not tell where up is: the sensor is taken to be mounted as "
                "stated; state roll, pitch and yaw in degrees by --mount"
            )
        elif settings.mount is not None and tilt > settings.mount_error:
            off = np.degrees(tilt)
            _log.warning("the sensor hangs %.0f degrees off the stated mount, as its surroundings show", off)
        elif not found.sign_sure or (not found.sign_told and tilt > np.radians(45)):
            _log.warning("which way is up is not sure; state roll, pitch and yaw of the sensor by --mount")
        self.known, self.likely_up, self._points, self._poses = True, up, [], []
