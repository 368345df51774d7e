"""A LiDAR-inertial library as an odometry of a run."""

import logging
from collections.abc import Callable
from dataclasses import astuple
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.imu import ImuSamples
from data.trajectory.stamps import ns_to_seconds
from sgslam.config import OdometrySettings
from sgslam.geometry.frames import inverse, squared_up
from sgslam.inertial import ImuBuffer
from sgslam.odometry.base import State
from sgslam.odometry.lidar_inertial.library import InertialLibrary, InertialScan, Registered
from sgslam.odometry.lidar_inertial.recent_scans import RecentScans
from sgslam.odometry.lidar_inertial.rest import rest_before, samples_at_rest
from sgslam.odometry.rigid import Fit, RigidOdometry, end_of
from sgslam.odometry.steps import plausible
from sgslam.registration import Registration

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
_LEAST = 20  # points that a registration needs
_SUSPICIOUS = 0.5  # of the usual share of points near recent ones; in eight drives on a hand at least 0.68 of it
_PATIENCE = 5  # consecutive scans without a registration before the library starts again
_KEPT_NS = 5_000_000_000  # of the newest scans, from which a restored odometry begins


class LidarInertialOdometry(RigidOdometry):
    """Gives each scan to a library with the samples of an IMU. Between the ends of two scans the motion is steady.

    The library tells neither how much of a scan it explains nor a covariance of its steps: scans are compared with the
    recent ones, and the covariance is that of `odometry.other_sigma_*`. After several scans that do not fit the library
    starts again. Its state cannot be read: one that is restored restarts from the scans of the last five seconds. It
    goes on bit by bit only if these are all scans; else its poses differ a little, without the older part of its map.
    """

    _STATE = (*RigidOdometry._STATE, "_up", "_rest", "_T_odom_library", "_is_whole", "_fed_ns", "_misfits")

    def __init__(
        self, settings: OdometrySettings, imu: ImuBuffer | None, begin: Callable[[ImuSamples], InertialLibrary]
    ) -> None:
        """`begin` begins a library's odometry after samples at rest. Raises UserError without an IMU."""
        if imu is None:
            raise UserError(f"odometry {settings.method}: needs an IMU; give its samples with --imu FILE or add_imu")
        super().__init__(settings)
        self._imu, self._begin = imu, begin
        self._library: InertialLibrary | None = None
        self._recent = RecentScans(settings)
        self._covariance = np.diag(np.repeat([settings.other_sigma_rotation, settings.other_sigma_translation], 3) ** 2)
        self._stamp_ns = 0  # of the newest scan
        self._up: Floats | None = None  # in `odom`, once it is known
        self._rest: Floats | None = None  # (6,) at which the library began
        self._T_odom_library: Floats | None = None
        self._kept: list[tuple[InertialScan, Floats]] = []  # the newest scans that the library got, and their poses
        self._is_whole = True  # whether these are all that it got
        self._fed_ns = 0  # until when it got samples
        self._misfits = 0  # consecutive scans without a registration
        self._warned = False

    def level(self, up_in_odom: Floats) -> None:
        """See `Odometry.level`: told to the library where it starts again."""
        self._up = up_in_odom

    def register(self, stamp_ns: int, points: Floats, point_times: Floats | None = None) -> Registration:
        """See `Odometry.register`. Raises UserError if there was no sample of an IMU yet."""
        if self._imu.newest_ns is None:
            raise UserError(
                f"odometry {self._settings.method}: no sample of an IMU before the scan at {ns_to_seconds(stamp_ns)} s"
                "; give them with --imu FILE or add_imu, by the scans' clock"
            )
        self._stamp_ns = stamp_ns
        return super().register(stamp_ns, points, point_times)

    def _fit(self, points: Floats, point_times: Floats | None, predicted: Floats, seconds: float) -> Fit | None:
        is_blind = len(points) < _LEAST
        if is_blind and not self._kept:
            return None  # the library begins with points
        end_ns = self._stamp_ns + round(end_of(point_times) * 1e9)
        times = np.zeros(len(points)) if point_times is None else point_times
        count = 0 if is_blind else len(points)
        scan = InertialScan(self._stamp_ns, end_ns, points[:count].astype(np.float32), times[:count])
        fit = self._judged(self._given(scan, predicted), predicted)
        if self._fed_ns == end_ns:
            self._keep(scan, predicted if fit is None else fit.T)
        if not is_blind:
            self._misfits = 0 if fit is not None else self._misfits + 1
        if self._misfits > _PATIENCE:
            self._give_up()
        return fit

    def _given(self, scan: InertialScan, predicted: Floats) -> Registered | None:
        """What the library makes of a scan; None where it does not fit, or samples are missing."""
        if self._library is None and self._kept:
            self._replay()
        if self._library is None:
            self._begin_at(scan, None if self._up is None or not self._scans else predicted)
        samples = None if self._library is None else self._imu.within(self._fed_ns, scan.end_ns)
        if self._library is None or samples is None:
            self._warn_of_gap(scan)
            return None
        self._fed_ns = scan.end_ns
        return self._library.register(scan, samples)

    def _begin_at(self, scan: InertialScan, T_odom_sensor: Floats | None) -> None:
        """Begins the library's odometry before a scan, where there are samples; up is known by a pose (4, 4)."""
        if T_odom_sensor is not None and self._up is not None:
            self._rest = rest_before(self._imu, scan, T_odom_sensor[:3, :3].T @ self._up)
        else:
            self._rest = rest_before(self._imu, scan, None)
        self._fed_ns = scan.stamp_ns - 1
        if self._rest is not None:
            self._library = self._begin(samples_at_rest(self._rest, scan.stamp_ns))

    def _replay(self) -> None:
        """Gives the library the scans that were kept: those of the whole run as it got them, else from a new beginning,
        which is put where the newest of them was."""
        first, T_odom_first = self._kept[0]
        if self._is_whole and self._rest is not None:
            self._library = self._begin(samples_at_rest(self._rest, first.stamp_ns))
            self._fed_ns = first.stamp_ns - 1
        else:
            self._begin_at(first, T_odom_first)
        kept, self._kept = self._kept, []
        for scan, T_odom_sensor in kept:
            found = self._given(scan, T_odom_sensor)
            if found is not None and not self._is_whole:
                self._T_odom_library = T_odom_sensor @ inverse(found.T_library_sensor)
        self._kept = kept

    def _judged(self, found: Registered | None, predicted: Floats) -> Fit | None:
        """How a registered scan fits the recent ones, which it joins; None where it does not."""
        if found is None:
            return None
        if self._T_odom_library is None:
            self._T_odom_library = predicted @ inverse(found.T_library_sensor)
        T = squared_up(self._T_odom_library @ found.T_library_sensor)
        fit = Fit(T, *self._recent.compared(found.points, T), self._covariance)
        fits = fit.share > _SUSPICIOUS * self._usual and plausible(inverse(self._last) @ T, self._settings)
        if not fits:
            return None
        self._recent.add(found.points, T)
        return fit

    def _keep(self, scan: InertialScan, T_odom_sensor: Floats) -> None:
        """Keeps a scan that the library got, and forgets old ones."""
        self._kept.append((scan, T_odom_sensor))
        while scan.end_ns - self._kept[0][0].end_ns > _KEPT_NS:
            del self._kept[0]
            self._is_whole = False

    def _give_up(self) -> None:
        """Has the library start again at the next scan."""
        _log.warning("scan %d: the odometry lost its track and begins a new local map", self._scans)
        self._library, self._rest, self._T_odom_library = None, None, None
        self._kept, self._is_whole, self._misfits = [], True, 0
        self._recent.clear()

    def _warn_of_gap(self, scan: InertialScan) -> None:
        """Warns of the first scan without samples."""
        if not self._warned:
            seconds = ns_to_seconds(scan.stamp_ns)
            _log.warning("no samples of the IMU around the scan at %s s: such scans are lost (reported once)", seconds)
            self._warned = True

    def state(self) -> dict[str, Any]:
        """See `Odometry.state`."""
        kept = [(*astuple(scan), T) for scan, T in self._kept]
        return super().state() | {"recent": self._recent.state(), "kept": kept}

    def restore(self, state: State) -> None:
        """See `Odometry.restore`."""
        super().restore(state)
        self._recent.restore(state["recent"])
        self._kept = [(InertialScan(*kept[:-1]), kept[-1]) for kept in state["kept"]]
        self._library = None
