"""RKO-LIO (Malladi et al., RA-L 2026): point-to-point ICP that begins where the IMU predicts the sensor."""

import atexit
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

import numpy as np

from data.imu import ImuSamples
from sgslam.config import OdometrySettings
from sgslam.odometry.lidar_inertial.library import InertialScan, Registered, imported

_ORIGIN_NS = 1_000_000_000_000  # of the times that it gets: it takes 0 for unknown


class RkoLio:
    """RKO-LIO's odometry, on one thread, so that the same input gives the same output.

    It begins at its second scan: the first one given to it only sets the time at which the samples at rest begin.
    """

    def __init__(self, settings: OdometrySettings, rest: ImuSamples) -> None:
        """Raises UserError if the library is missing."""
        module = imported("rko_lio")
        _keep_stdout_clean()
        self._errors = imported("rko_lio.rko_lio_pybind")
        config = imported("rko_lio.config").LIOConfig(
            voxel_size=settings.rko_voxel_size, max_range=settings.max_range, min_range=settings.min_range,
            max_iterations=settings.iterations, max_correspondence_distance=settings.rko_reach,
            initialization_phase=True, max_num_threads=1,
        )  # fmt: skip
        self._lio: Any = module.LIO(config)
        self._rest: ImuSamples | None = rest
        self._first_ns = int(rest.stamps_ns[0])

    def register(self, scan: InertialScan, samples: ImuSamples) -> Registered | None:
        """See `InertialLibrary.register`."""
        if self._rest is not None and len(scan.points):
            rest, self._rest = self._rest, None
            with _stdout_to_stderr():
                self._lio.register_scan(scan.points, np.full(len(scan.points), self._time(self._first_ns - 1)))
                self._add(rest)
                return self._registered(scan)
        if self._rest is None:
            self._add(samples)
        return self._registered(scan) if len(scan.points) else None

    def _registered(self, scan: InertialScan) -> Registered | None:
        times = self._time(scan.stamp_ns) + np.rint(scan.seconds * 1e9).astype(np.int64)
        try:
            points = self._lio.register_scan(scan.points, times, end_time_ns=self._time(scan.end_ns))
        except (self._errors.InputError, self._errors.RegistrationError):
            return None
        return Registered(self._lio.pose(), points.reshape(-1, 3)) if len(points) else None

    def _add(self, samples: ImuSamples) -> None:
        for stamp_ns, gyro, accel in zip(samples.stamps_ns.tolist(), samples.gyro, samples.accel, strict=True):
            self._lio.add_imu_measurement(accel, gyro, self._time(stamp_ns))

    def _time(self, stamp_ns: int) -> int:
        return stamp_ns - self._first_ns + _ORIGIN_NS


@contextmanager
def _stdout_to_stderr() -> Iterator[None]:
    """What the library says of its beginning, it prints on the command's standard output."""
    sys.stdout.flush()
    stdout = os.dup(1)
    os.dup2(2, 1)
    try:
        yield
    finally:
        os.dup2(stdout, 1)
        os.close(stdout)


@cache
def _keep_stdout_clean() -> None:
    """At the end of the process, too, where the library prints how long it took."""

    def redirect() -> None:
        sys.stdout.flush()
        os.dup2(2, 1)

    atexit.register(redirect)
