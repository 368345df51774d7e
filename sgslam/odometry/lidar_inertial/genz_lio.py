"""GenZ-LIO (2026): an error-state Kalman filter on planes of a voxel map, and on points where there are none."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.imu import ImuSamples
from sgslam.config import OdometrySettings
from sgslam.odometry.lidar_inertial.library import InertialScan, Registered, imported

Floats = NDArray[np.float64]
_BEGIN_S = 1.0  # the time of the first sample at rest, as it gets it
_CONFIG = "configs/default/mid360.yaml"  # of any sensor with point times: they are not checked as a Velodyne's


class GenzLio:
    """GenZ-LIO's odometry with its default settings, on one thread, so that the same input gives the same output."""

    def __init__(self, settings: OdometrySettings, rest: ImuSamples) -> None:
        """Raises UserError if the library is missing."""
        module = imported("genz_lio")
        config = module.load_config(Path(module.__file__).parent / _CONFIG)
        config.max_threads = 1
        config.preprocess.blind_min, config.preprocess.blind_max = settings.min_range, settings.max_range
        self._lio: Any = module.GenZLIO(config)
        self._first_ns = int(rest.stamps_ns[0])
        nothing = InertialScan(self._first_ns, int(rest.stamps_ns[-1]), np.empty((0, 3), np.float32), np.empty(0))
        self.register(nothing, rest)

    def register(self, scan: InertialScan, samples: ImuSamples) -> Registered | None:
        """See `InertialLibrary.register`."""
        if not len(samples):
            return None
        begin, end = self._seconds(np.array([scan.stamp_ns, scan.end_ns]))
        rows = np.column_stack([self._seconds(samples.stamps_ns), samples.accel, samples.gyro])
        found = self._lio.register_scan(scan.points, begin, end, rows, timestamps=scan.seconds)
        if not found.valid or found.update_rejected:
            return None
        return Registered(self._lio.lidar_pose, found.deskewed.reshape(-1, 3))

    def _seconds(self, stamps_ns: NDArray[np.int64]) -> Floats:
        """Seconds (N,) since the first sample, small enough for a microsecond to count."""
        return np.asarray((stamps_ns - self._first_ns) / 1e9 + _BEGIN_S)
