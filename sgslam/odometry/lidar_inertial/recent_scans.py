"""The recent scans of an odometry whose own map cannot be asked how well a scan fits it."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sgslam.config import OdometrySettings
from sgslam.odometry.base import State
from sgslam.odometry.steps import far_apart

Floats = NDArray[np.float64]
_NEAR = 0.2  # m; a point this close to one of the recent scans counts as explained by them
_MAPPED, _ASKED = 5000, 1000  # points of a scan that are kept, and that are compared


class RecentScans:
    """The last `odometry.gicp_scans` scans that are `odometry.gicp_spacing` apart, as points in `odom`."""

    def __init__(self, settings: OdometrySettings) -> None:
        self._settings = settings
        self._window: list[Floats] = []  # points (N, 3) of each scan
        self._newest = np.eye(4)  # T_odom_sensor of the newest of them
        self._tree: cKDTree | None = None  # of all points, built on demand

    def compared(self, points: Floats, T_odom_sensor: Floats) -> tuple[float, float]:
        """The share of a scan's points (N, 3), N >= 1, near those of the recent scans, and the mean distance (m), of
        which no point counts for more than 0.2; 1 and infinity if there are none."""
        if not self._window:
            return 1.0, np.inf
        if self._tree is None:
            self._tree = cKDTree(np.concatenate(self._window))
        distance, _ = self._tree.query(_thinned(points, T_odom_sensor, _ASKED), distance_upper_bound=_NEAR)
        return float(np.mean(np.isfinite(distance))), float(np.minimum(distance, _NEAR).mean())

    def add(self, points: Floats, T_odom_sensor: Floats) -> None:
        """Adds a scan if it is far enough from the newest of the recent ones."""
        if self._window and not far_apart(self._newest, T_odom_sensor, self._settings.gicp_spacing):
            return
        newer = [*self._window, _thinned(points, T_odom_sensor, _MAPPED)]
        self._window, self._newest, self._tree = newer[-self._settings.gicp_scans :], T_odom_sensor, None

    def clear(self) -> None:
        """Forgets all scans."""
        self._window, self._tree = [], None

    def state(self) -> dict[str, Any]:
        """The state as a tree."""
        return {"window": self._window, "newest": self._newest}

    def restore(self, state: State) -> None:
        """Restores what `state` returned."""
        self._window, self._newest, self._tree = list(state["window"]), state["newest"], None


def _thinned(points: Floats, T_odom_sensor: Floats, most: int) -> Floats:
    """(M, 3) in `odom`: every so many of the points (N, 3) in the sensor frame, `most` of them or somewhat more."""
    kept = points[:: max(len(points) // most, 1)]
    return np.asarray(kept @ T_odom_sensor[:3, :3].T + T_odom_sensor[:3, 3])
