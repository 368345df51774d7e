"""A LiDAR-inertial library that is given scans with the samples of an IMU, and that can be begun again."""

import logging
from collections.abc import Callable
from dataclasses import astuple
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.imu import ImuSamples
from data.trajectory.stamps import ns_to_seconds
from sgslam.geometry.frames import inverse
from sgslam.inertial import ImuBuffer
from sgslam.odometry.base import State
from sgslam.odometry.lidar_inertial.library import InertialLibrary, InertialScan, Registered
from sgslam.odometry.lidar_inertial.rest import rest_before, samples_at_rest

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
_KEPT_NS = 5_000_000_000  # of the newest scans, from which a restored odometry begins


class FedLibrary:
    """Begins the library with the first scan, and gives it each scan with the samples since the one before.

    The library's state cannot be read: one that is restored begins with the newest scans, those of the last five
    seconds. `up` is the direction of gravity (3,) in `odom`, None until it is known. `T_odom_library` (4, 4) is the
    library's frame in `odom`, None until its first scan was placed.
    """

    _STATE = ("up", "_rest", "T_odom_library", "_is_whole", "_fed_ns")

    def __init__(self, imu: ImuBuffer, begin: Callable[[ImuSamples], InertialLibrary]) -> None:
        """`begin` begins the library's odometry after samples at rest."""
        self._imu, self._begin = imu, begin
        self._library: InertialLibrary | None = None
        self.up: Floats | None = None
        self._rest: Floats | None = None  # (6,) at which the library began
        self.T_odom_library: Floats | None = None
        self._kept: list[tuple[InertialScan, Floats]] = []  # the newest scans that the library got, and their poses
        self._is_whole = True  # whether these are all that it got
        self._fed_ns = 0  # until when it got samples
        self._warned = False

    @property
    def has_scans(self) -> bool:
        """Whether a scan was given to the library since it began."""
        return bool(self._kept)

    def register(self, scan: InertialScan, T_odom_sensor: Floats | None) -> Registered | None:
        """What the library makes of a scan; None where it does not fit, or samples are missing. `T_odom_sensor` (4, 4)
        is its predicted pose, None of the first scan of all."""
        if self._library is None and self._kept:
            self._replay()
        if self._library is None:
            self._begin_at(scan, T_odom_sensor)
        samples = None if self._library is None else self._imu.within(self._fed_ns, scan.end_ns)
        if self._library is None or samples is None:
            self._warn_of_gap(scan)
            return None
        self._fed_ns = scan.end_ns
        return self._library.register(scan, samples)

    def keep(self, scan: InertialScan, T_odom_sensor: Floats) -> None:
        """Keeps a scan with its pose (4, 4) if the library got it, and forgets old ones."""
        if self._fed_ns != scan.end_ns:
            return
        self._kept.append((scan, T_odom_sensor))
        while scan.end_ns - self._kept[0][0].end_ns > _KEPT_NS:
            del self._kept[0]
            self._is_whole = False

    def give_up(self) -> None:
        """Has the library begin again at the next scan."""
        self._library, self._rest, self.T_odom_library = None, None, None
        self._kept, self._is_whole = [], True

    def _begin_at(self, scan: InertialScan, T_odom_sensor: Floats | None) -> None:
        """Begins the library's odometry before a scan, where there are samples; up is known by a pose (4, 4)."""
        if T_odom_sensor is not None and self.up is not None:
            self._rest = rest_before(self._imu, scan, T_odom_sensor[:3, :3].T @ self.up)
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
            found = self.register(scan, T_odom_sensor)
            if found is not None and not self._is_whole:
                self.T_odom_library = T_odom_sensor @ inverse(found.T_library_sensor)
        self._kept = kept

    def _warn_of_gap(self, scan: InertialScan) -> None:
        """Warns of the first scan without samples."""
        if not self._warned:
            seconds = ns_to_seconds(scan.stamp_ns)
            _log.warning("no samples of the IMU around the scan at %s s: such scans are lost (reported once)", seconds)
            self._warned = True

    def state(self) -> dict[str, Any]:
        """The state as a tree."""
        kept = [(*astuple(scan), T) for scan, T in self._kept]
        return {f"_{name.removeprefix('_')}": getattr(self, name) for name in self._STATE} | {"kept": kept}

    def restore(self, state: State) -> None:
        """Restores what `state` returned."""
        for name in self._STATE:
            setattr(self, name, state[f"_{name.removeprefix('_')}"])
        self._kept = [(InertialScan(*kept[:-1]), kept[-1]) for kept in state["kept"]]
        self._library = None
