"""Finds where up is, from the surfaces of the first seconds: the mount is not known, and a hand is never level."""

import logging

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sgslam.config import TrackingSettings
from sgslam.config.sensor import CARRIER
from sgslam.geometry.frames import inverse, levelling
from sgslam.perception.gravity import ALIKE, Gravity, find_gravity
from sgslam.registration.motion import few_points
from sgslam.surfels import SurfelMap
from sgslam.types import TrackedScan

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
_BETWEEN_NS = 1_000_000_000  # between two attempts
_SWAYS = 0.5  # rad, between the sensor and its stated mount in a hand, at most


class LevelFrame:
    """`likely_up` (3,) is the best answer so far, in the frame of the first pose, at first the mount's.

    Surfaces show the axis, and an accelerometer which end of it is up; without one it is the end nearer to the mount.
    `sure` tells whether that is good enough. `advice` is a line where the stated mount proves wrong, else None.
    """

    def __init__(self, settings: TrackingSettings) -> None:
        self._settings = settings
        roll, pitch, yaw = settings.mount or (0.0, 0.0, 0.0)
        # up in the first sensor's axes, if the carrier stands upright
        self._expected: Floats = Rotation.from_euler("ZYX", (yaw, pitch, roll), degrees=True).as_matrix()[2]
        self.likely_up = self._expected
        self.sure = False
        self.advice: str | None = None
        self._looked_ns: int | None = None  # the stamp of the last attempt
        self._measured: Floats | None = None  # up by an accelerometer

    @property
    def is_way_up_assumed(self) -> bool:
        """Whether the sensor is taken not to hang upside down, without a stated mount or an accelerometer."""
        return self._settings.mount is None and self._measured is None

    @property
    def T_level_first(self) -> Floats:  # noqa: N802
        """(4, 4) turns the frame of the first pose upright; with that pose's place and heading."""
        T = np.eye(4)
        T[:3, :3] = levelling(self.likely_up)
        return T

    def add(self, scans: list[TrackedScan], measured_up: Floats | None) -> None:
        """Looks for gravity when it is time, in all scans so far, with poses in any frame.

        `measured_up` (3,) is up as an accelerometer shows it, in the frame of the first pose; None: not known yet.
        """
        began_ns, stamp_ns = scans[0].raw.stamp_ns, scans[-1].raw.stamp_ns
        if measured_up is not None:
            self._measured = self.likely_up = measured_up
        if stamp_ns - (began_ns if self._looked_ns is None else self._looked_ns) < _BETWEEN_NS:
            return
        self._looked_ns = stamp_ns
        is_time = stamp_ns - began_ns >= 1e9 * self._settings.gravity_after
        if self._measured is not None:
            self.sure = is_time
            return
        seen = self._seen(scans)
        if seen is not None and seen.is_sure:
            self.likely_up = seen.up
            self.sure = is_time and self._tilt(seen.up) < CARRIER.lying

    def settle(self, scans: list[TrackedScan]) -> None:
        """Ends the search with all scans; where nothing is found, up is where the mount says."""
        seen, measured = self._seen(scans), self._measured
        if seen is None and measured is None:
            self.likely_up = self._expected
            _log.warning("the first seconds do not show the vertical, so the mount is taken for it; give --mount")
            return
        if seen is not None and (measured is None or seen.up @ measured > np.cos(ALIKE)):
            self.likely_up = seen.up
        tilt, is_stated = self._tilt(self.likely_up), self._settings.mount is not None
        shown = "its surroundings show" if measured is None else "the accelerometer shows"
        mount = "its stated mount" if is_stated else "upright"
        _log.info("the sensor begins %.0f degrees off %s, as %s", np.degrees(tilt), mount, shown)
        if is_stated and tilt > _SWAYS:
            self.advice = self._correction(tilt, shown)
            _log.warning("%s", self.advice)
        elif measured is None and (tilt > CARRIER.lying or not (seen and seen.is_sure)):
            _log.warning("the vertical is not certain; give roll, pitch and yaw of the sensor with --mount")

    def _tilt(self, up: Floats) -> float:
        """The angle (rad) between up (3,) and that of the mount."""
        return float(np.arccos(np.clip(up @ self._expected, -1.0, 1.0)))

    def _correction(self, tilt: float, shown: str) -> str:
        """A line that says by how much (rad) the stated mount is wrong, and what is right."""
        x, y, z = self.likely_up
        roll, pitch = np.degrees([np.arctan2(y, z), np.arctan2(-x, np.hypot(y, z))])
        return (
            f"the sensor is turned {np.degrees(tilt):.0f} degrees from the stated mount, as {shown}: its roll is "
            f"{roll:.0f} and its pitch {pitch:.0f} degrees, approximately; correct --mount, or leave it out"
        )

    def _seen(self, scans: list[TrackedScan]) -> Gravity | None:
        """What the surfaces of all scans show, in the frame of the first pose."""
        surfels, T_first_odom = SurfelMap(), inverse(scans[0].T_odom_sensor)
        poses = [T_first_odom @ scan.T_odom_sensor for scan in scans]
        for scan, T_first_sensor in zip(scans, poses, strict=True):
            surfels.add_scan(few_points(scan.registration, scan.raw.points, self._settings), T_first_sensor)
        expected = self._expected if self._measured is None else self._measured
        return find_gravity(surfels.surfels(), np.stack(poses)[:, :3, 3], expected, not self.is_way_up_assumed)
