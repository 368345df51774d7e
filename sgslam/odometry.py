"""Odometry behind one interface: a scan goes in, T_odom_sensor comes out."""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from sgslam.config import OdometrySettings

Floats = NDArray[np.float64]


class Odometry(Protocol):
    """Anything that tracks the sensor from scan to scan."""

    def register(self, points: Floats) -> Floats:
        """Takes (N, 3) points of one scan in the sensor frame; returns (4, 4) T_odom_sensor."""
        ...


class KissOdometry:
    """KISS-ICP (Vizzo et al., RA-L 2023) with an indoor voxel size."""

    def __init__(self, settings: OdometrySettings) -> None:
        from kiss_icp.config import KISSConfig
        from kiss_icp.config.config import DataConfig, MappingConfig
        from kiss_icp.kiss_icp import KissICP

        data = DataConfig(max_range=settings.max_range, min_range=settings.min_range, deskew=False)
        self._kiss = KissICP(KISSConfig(data=data, mapping=MappingConfig(voxel_size=settings.voxel_size)))

    def register(self, points: Floats) -> Floats:
        """See `Odometry.register`."""
        self._kiss.register_frame(points, np.empty(0))
        return self._kiss.last_pose.copy()
