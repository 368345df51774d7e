"""KISS-ICP (Vizzo et al., RA-L 2023) as published, with voxels for indoor scans."""

from typing import Any

import numpy as np
from kiss_icp.config import KISSConfig
from kiss_icp.config.config import AdaptiveThresholdConfig, DataConfig, MappingConfig, RegistrationConfig
from kiss_icp.kiss_icp import KissICP
from numpy.typing import NDArray

from sgslam.config import OdometrySettings, TrackingSettings
from sgslam.geometry.frames import angle_of, squared_up
from sgslam.odometry.base import LEAST, at_stamp, end_of, is_snapshot, seconds_since

Floats = NDArray[np.float64]


class KissOdometry:
    """Runs on one thread, so that the same input gives the same output. `T_odom_end` (4, 4) is the pose at the end of
    the newest scan, to which KISS-ICP undistorts it."""

    def __init__(self, settings: OdometrySettings, tracking: TrackingSettings) -> None:
        adaptive = AdaptiveThresholdConfig()
        self._threshold = _Threshold(adaptive.initial_threshold, adaptive.min_motion_th, tracking.max_range)
        self._settings, self._tracking = settings, tracking
        self._kiss = self._made()
        self.T_odom_end = np.eye(4)
        self._ended_ns: int | None = None

    def _made(self) -> KissICP:
        data = DataConfig(max_range=self._tracking.max_range, min_range=self._tracking.min_range)
        # one point in each: of the least error in two drives, with the setting's voxels
        mapping = MappingConfig(voxel_size=self._settings.voxel_size, max_points_per_voxel=1)
        made = KissICP(KISSConfig(data=data, mapping=mapping, registration=RegistrationConfig(max_num_threads=1)))
        made.adaptive_threshold = self._threshold
        return made

    def locate(self, stamp_ns: int, points: Floats, point_times: Floats | None = None) -> Floats:
        """See `Odometry.locate`."""
        before, end = self.T_odom_end, end_of(point_times)
        if len(points) < LEAST:
            self._kiss.last_pose = self._kiss.last_pose @ self._kiss.last_delta
        else:
            self._kiss.register_frame(points, np.empty(0) if is_snapshot(point_times) else point_times)
        self.T_odom_end = squared_up(self._kiss.last_pose)
        before_ns, self._ended_ns = self._ended_ns, stamp_ns + round(end * 1e9)
        return at_stamp(before, self.T_odom_end, seconds_since(before_ns, self._ended_ns), end)

    def __getstate__(self) -> dict[str, Any]:
        """The attributes, with what KISS-ICP holds in place of itself."""
        kiss = self._kiss
        held = kiss.local_map.point_cloud().reshape(-1, 3), kiss.last_pose, kiss.last_delta
        return {**vars(self), "_kiss": held}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Makes KISS-ICP again."""
        vars(self).update(state)
        points, last_pose, last_delta = state["_kiss"]
        self._kiss = self._made()
        self._kiss.local_map.add_points(np.ascontiguousarray(points))
        self._kiss.last_pose, self._kiss.last_delta = last_pose, last_delta


class _Threshold:
    """KISS-ICP's adaptive threshold (section III-C of its paper) with accessible sums, so that they can be saved."""

    def __init__(self, initial: float, least_motion: float, max_range: float) -> None:
        self.sum, self.count = initial**2, 1  # of squared deviations (m2)
        self._least, self._range = least_motion, max_range

    def get_threshold(self) -> float:
        """The threshold (m)."""
        return float(np.sqrt(self.sum / self.count))

    def update_model_deviation(self, deviation: Floats) -> None:
        """Adds the deviation (4, 4) of a registration from its prediction."""
        error = 2 * self._range * np.sin(angle_of(deviation) / 2) + float(np.linalg.norm(deviation[:3, 3]))
        if error > self._least:
            self.sum, self.count = self.sum + error**2, self.count + 1
