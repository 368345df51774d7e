"""Finds where up is, from the surfaces of the first seconds: the mount is not known, and a hand is never level."""

import logging
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sgslam.config import TrackingSettings
from sgslam.geometry.frames import inverse, levelling
from sgslam.registration import Registration
from sgslam.registration.sampling import one_a_cell
from sgslam.serialization import Stateful
from sgslam.surfels import SurfelMap
from sgslam.tracking.gravity import Gravity, estimate_gravity

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
_log = logging.getLogger(__name__)
SIDE = 0.1  # m between the points of a scan that are used
_BETWEEN_NS = 1_000_000_000  # between two attempts
_LIES = np.radians(45)  # of tilt: beyond it the usual mount says nothing of the sign, which surfaces alone show badly


class LevelFrame(Stateful):
    """`T_level_first` (4, 4) turns the frame of the first pose upright; `known` once that is settled.

    Until then `likely_up` (3,) is the best answer so far, in that frame: `found` in the surfaces, or where the mount
    says, and `sure` tells whether it is good enough. What an accelerometer shows counts for the sign, and for the axis
    unless the surfaces tell it within `up_error` (rad) of that. `advice` is a line where the stated mount proves
    wrong, else None.
    """

    _STATE = ("known", "sure", "found", "likely_up", "advice", "_began_ns", "_next_ns", "_chosen", "_measured")

    def __init__(self, settings: TrackingSettings, up_error: float) -> None:
        self._settings, self._up_error = settings, up_error
        roll, pitch, yaw = settings.mount or (0.0, 0.0, 0.0)
        # up in the first sensor's axes, if the carrier stands upright
        self._expected: Floats = Rotation.from_euler("ZYX", (yaw, pitch, roll), degrees=True).as_matrix()[2]
        self.likely_up = self._expected
        self.known, self.sure, self.found = False, False, False
        self.advice: str | None = None
        self._began_ns: int | None = None
        self._next_ns = 0
        self._measured: Floats | None = None  # up by an accelerometer
        self._chosen: list[tuple[Floats, Ints]] = []  # of each scan, some points (N, 3) and their indices (N,)

    @property
    def is_way_up_assumed(self) -> bool:
        """Whether the sensor is taken not to hang upside down, without a stated mount or an accelerometer:
        the surfaces of the first seconds look much alike both ways up."""
        return self._settings.mount is None and self._measured is None

    @property
    def T_level_first(self) -> Floats:  # noqa: N802
        """(4, 4) with the first pose's place and heading."""
        T = np.eye(4)
        T[:3, :3] = levelling(self.likely_up)
        return T

    def measure(self, up: Floats | None) -> None:
        """Takes up (3,) as an accelerometer shows it by now, in the frame of the first pose; None: not known yet."""
        if up is not None:
            self._measured = self.likely_up = up
            self.found = True

    def add(self, stamp_ns: int, points: Floats, results: list[Registration]) -> None:
        """Adds a scan (N, 3), and looks for gravity when it is time; `results` are those of all scans so far."""
        settings = self._settings
        if self._began_ns is None:
            self._began_ns, self._next_ns = stamp_ns, stamp_ns + _BETWEEN_NS
        chosen = one_a_cell(points, SIDE, settings.min_range, settings.max_range)
        self._chosen.append((points.take(chosen, axis=0), chosen))
        if stamp_ns < self._next_ns:
            return
        self._next_ns = stamp_ns + _BETWEEN_NS
        if self._measured is not None:
            self.sure = self.waited_s(stamp_ns) >= settings.gravity_after
            return
        found = self._estimate(results)
        if found is not None and found.axis_sure:
            self.found, self.likely_up = True, found.up_in_odom
            self.sure = found.sign_sure and self.waited_s(stamp_ns) >= settings.gravity_after

    def waited_s(self, stamp_ns: int) -> float:
        """Seconds since the first scan."""
        return 0.0 if self._began_ns is None else (stamp_ns - self._began_ns) / 1e9

    def settle(self, results: list[Registration]) -> None:
        """Ends the search with the `results` of all scans; where nothing is found, up is where the mount says."""
        found = self._estimate(results)
        if self._measured is not None:
            self._settle_measured(self._measured, found)
            return
        up = self._expected if found is None else found.up_in_odom
        if found is not None and not found.sign_sure and up @ self._expected < 0:
            up = -up
        tilt = float(np.arccos(np.clip(up @ self._expected, -1.0, 1.0)))
        if found is None:
            _log.warning(
                "the surfaces of the first seconds do not show the vertical: the sensor is assumed to be mounted as "
                "stated; give roll, pitch and yaw in degrees with --mount"
            )
        elif not self._contradicts_mount(up, tilt, "its surroundings show") and (
            not (found.axis_sure and found.sign_sure) or tilt > _LIES
        ):
            _log.warning("the vertical is not certain; give roll, pitch and yaw of the sensor with --mount")
        if found is not None:
            self._tell(float(np.degrees(tilt)))
        self.known, self.likely_up, self._chosen = True, up, []

    def _settle_measured(self, measured: Floats, found: Gravity | None) -> None:
        """Ends the search with up as the accelerometer shows it, and more exactly by the surfaces if these agree."""
        up = measured
        if found is not None:
            axis = found.up_in_odom if found.up_in_odom @ measured > 0 else -found.up_in_odom
            if axis @ measured > np.cos(self._up_error):
                up = axis
        tilt = float(np.arccos(np.clip(up @ self._expected, -1.0, 1.0)))
        self._contradicts_mount(up, tilt, "the accelerometer shows")
        _log.info("the sensor begins %.0f degrees off its mount, as the accelerometer shows", np.degrees(tilt))
        self.known, self.likely_up, self._chosen = True, up, []

    def _contradicts_mount(self, up: Floats, tilt: float, as_shown: str) -> bool:
        """Whether up, (3,) in the sensor's frame at its first pose, is so far (rad) off the stated mount that this is
        wrong; then it is advised to correct it."""
        if self._settings.mount is None or tilt <= self._settings.mount_error:
            return False
        roll, pitch = np.degrees([np.arctan2(up[1], up[2]), np.arctan2(-up[0], np.hypot(up[1], up[2]))])
        self.advice = (
            f"the sensor is turned {np.degrees(tilt):.0f} degrees from the stated mount, as {as_shown}: its roll is "
            f"{roll:.0f} and its pitch {pitch:.0f} degrees, approximately; correct --mount, or leave it out"
        )
        _log.warning("%s", self.advice)
        return True

    def _tell(self, tilt_deg: float) -> None:
        if self._settings.mount is not None:
            _log.info("the sensor begins %.0f degrees off its stated mount, as its surroundings show", tilt_deg)
            return
        _log.info("the sensor begins %.0f degrees off upright, as its surroundings show", tilt_deg)

    def _estimate(self, results: list[Registration]) -> Gravity | None:
        """What the surfaces of all scans tell, in the frame of the first pose."""
        if not results:
            return None
        surfels, T_first_odom = SurfelMap(), inverse(results[0].T_odom_sensor)
        for (points, chosen), result in zip(self._chosen, results, strict=True):
            times = None if result.point_times is None else result.point_times.take(chosen)
            in_sensor = replace(result, point_times=times).undistorted(points)
            T = T_first_odom @ result.T_odom_sensor
            add_seen(surfels, in_sensor, T)
        places = np.stack([T_first_odom @ result.T_odom_sensor[:, 3] for result in results])[:, :3]
        return estimate_gravity(*surfels.surfels(), places, self._expected, self._settings.mount is not None)


def add_scan(surfels: SurfelMap, points: Floats, T_map_sensor: Floats, side: float, settings: TrackingSettings) -> None:
    """Adds a scan (N, 3) as `add_seen` does, one point in each cell of `side` metres."""
    chosen = one_a_cell(points, side, settings.min_range, settings.max_range)
    add_seen(surfels, points.take(chosen, axis=0), T_map_sensor)


def add_seen(surfels: SurfelMap, points: Floats, T_map_sensor: Floats) -> None:
    """Adds points (N, 3), in the frame of a sensor at a pose (4, 4), to the surfaces that it sees."""
    turned = points @ T_map_sensor[:3, :3].T
    rays = turned / np.linalg.norm(turned, axis=1, keepdims=True)
    surfels.add(turned + T_map_sensor[:3, 3], rays, 0.0, 1.0)
