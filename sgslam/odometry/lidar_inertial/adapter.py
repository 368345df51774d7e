"""A LiDAR-inertial library as an odometry of a run."""

import logging
from collections.abc import Callable
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
from sgslam.odometry.lidar_inertial.fed_library import FedLibrary
from sgslam.odometry.lidar_inertial.library import InertialLibrary, InertialScan, Registered
from sgslam.odometry.lidar_inertial.recent_scans import RecentScans
from sgslam.odometry.rigid import Fit, RigidOdometry, end_of
from sgslam.odometry.steps import plausible
from sgslam.registration import Registration

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
_LEAST = 20  # points that a registration needs
_SUSPICIOUS = 0.5  # of the usual share of points near recent ones; in eight drives on a hand at least 0.68 of it
_PATIENCE = 5  # consecutive scans without a registration before the library starts again


class LidarInertialOdometry(RigidOdometry):
    """Gives each scan to a library with the samples of an IMU. Between the ends of two scans the motion is steady.

    The library gives neither the share of a scan that it explains nor a covariance of its steps: scans are compared
    with the recent ones, and the covariance is that of `odometry.other_sigma_*`. After several scans that do not fit
    the library starts again. Its state cannot be read: one that is restored restarts from the scans of the last five
    seconds. It goes on bit by bit only if these are all scans; else its poses differ a little, without the older part
    of its map.
    """

    _STATE = (*RigidOdometry._STATE, "_misfits")

    def __init__(
        self, settings: OdometrySettings, imu: ImuBuffer | None, begin: Callable[[ImuSamples], InertialLibrary]
    ) -> None:
        """`begin` begins a library's odometry after samples at rest. Raises UserError without an IMU."""
        if imu is None:
            raise UserError(f"odometry {settings.method}: needs an IMU; give its samples with --imu FILE or add_imu")
        super().__init__(settings)
        self._imu, self._fed = imu, FedLibrary(imu, begin)
        self._recent = RecentScans(settings)
        self._covariance = np.diag(np.repeat([settings.other_sigma_rotation, settings.other_sigma_translation], 3) ** 2)
        self._stamp_ns = 0  # of the newest scan
        self._misfits = 0  # consecutive scans without a registration

    def level(self, up_in_odom: Floats) -> None:
        """See `Odometry.level`: given to the library where it starts again."""
        self._fed.up = up_in_odom

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
        if is_blind and not self._fed.has_scans:
            return None  # the library begins with points
        end_ns = self._stamp_ns + round(end_of(point_times) * 1e9)
        times = np.zeros(len(points)) if point_times is None else point_times
        count = 0 if is_blind else len(points)
        scan = InertialScan(self._stamp_ns, end_ns, points[:count].astype(np.float32), times[:count])
        fit = self._judged(self._fed.register(scan, predicted if self._scans else None), predicted)
        self._fed.keep(scan, predicted if fit is None else fit.T)
        if not is_blind:
            self._misfits = 0 if fit is not None else self._misfits + 1
        if self._misfits > _PATIENCE:
            self._give_up()
        return fit

    def _judged(self, found: Registered | None, predicted: Floats) -> Fit | None:
        """How a registered scan fits the recent ones, which it joins; None where it does not."""
        if found is None:
            return None
        if self._fed.T_odom_library is None:
            self._fed.T_odom_library = predicted @ inverse(found.T_library_sensor)
        T = squared_up(self._fed.T_odom_library @ found.T_library_sensor)
        fit = Fit(T, *self._recent.compared(found.points, T), self._covariance)
        fits = fit.share > _SUSPICIOUS * self._usual and plausible(inverse(self._last) @ T, self._settings)
        if not fits:
            return None
        self._recent.add(found.points, T)
        return fit

    def _give_up(self) -> None:
        """Has the library start again at the next scan."""
        _log.warning("scan %d: the odometry lost track and starts a new local map", self._scans)
        self._fed.give_up()
        self._misfits = 0
        self._recent.clear()

    def state(self) -> dict[str, Any]:
        """See `Odometry.state`."""
        return super().state() | self._fed.state() | {"recent": self._recent.state()}

    def restore(self, state: State) -> None:
        """See `Odometry.restore`."""
        super().restore(state)
        self._recent.restore(state["recent"])
        self._fed.restore(state)
