"""Generalized ICP (Segal et al., RSS 2009) of small_gicp (Koide, JOSS 2024) against a window of earlier scans."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from small_gicp import align, preprocess_points

from sgslam.config import TrackingSettings
from sgslam.geometry.frames import angle_of, inverse, squared_up
from sgslam.odometry.base import LEAST, ROUNDS, at_stamp, end_of, is_snapshot, seconds_since, steady_motion
from sgslam.registration.motion_prior import moved_on, velocity_between
from sgslam.registration.points import placed

Floats = NDArray[np.float64]
# of the least error in two drives, of 24 settings
# m: between points, and at most between two that correspond; also, m or rad, between scans of the local map
_VOXEL, _REACH = 0.25, 0.3
_SCANS = 15  # of the local map


class SmallGicpOdometry:
    """Runs on one thread, so that the same input gives the same output. The motion is steady from scan to scan.

    `T_odom_end` (4, 4) is the pose at the end of the newest scan, to which it is undistorted by the step that is found.
    With all scans in the local map, a standing robot would fill it with noise.
    """

    def __init__(self, tracking: TrackingSettings) -> None:
        self._tracking = tracking
        self.T_odom_end, self._velocity = np.eye(4), np.zeros(6)
        self._ended_ns: int | None = None
        self._window: list[tuple[Floats, Floats]] = []  # pose, and points (N, 3) in `odom`, of scans in the local map
        self._target: Any = None  # the local map in small_gicp's form with its search tree, made when needed

    def locate(self, stamp_ns: int, points: Floats, point_times: Floats | None = None) -> Floats:
        """See `Odometry.locate`."""
        before, before_ns, end = self.T_odom_end, self._ended_ns, end_of(point_times)
        self._ended_ns = stamp_ns + round(end * 1e9)
        seconds = seconds_since(before_ns, self._ended_ns)
        self.T_odom_end = np.asarray(moved_on(before, self._velocity, seconds))
        for _ in range(1 if is_snapshot(point_times) else ROUNDS):
            source, _ = preprocess_points(self._undistorted(points, point_times), _VOXEL)
            if not self._window or source.size() < LEAST:
                break
            if self._target is None:
                self._target = preprocess_points(np.concatenate([own for _, own in self._window]), _VOXEL)
            (target, tree), guess = self._target, self.T_odom_end
            found = align(target, source, tree, guess, registration_type="GICP", max_correspondence_distance=_REACH)
            self.T_odom_end = squared_up(found.T_target_source)
            self._velocity = np.asarray(velocity_between(before, self.T_odom_end, seconds))
        if source.size() >= LEAST:
            self._add(source.points()[:, :3])
        return at_stamp(before, self.T_odom_end, seconds, end)

    def _undistorted(self, points: Floats, point_times: Floats | None) -> Floats:
        """(N, 3) the points within range as at the scan's end."""
        distance, T = np.linalg.norm(points, axis=1), self.T_odom_end
        within = (distance > self._tracking.min_range) & (distance < self._tracking.max_range)
        if point_times is None:
            return points[within]
        motion = steady_motion(T, self._velocity, end_of(point_times), point_times)
        in_odom = placed(points[within], point_times[within], motion.seconds, motion.knots)[0]
        return np.asarray((in_odom - T[:3, 3]) @ T[:3, :3])

    def _add(self, points: Floats) -> None:
        """Adds points (N, 3) of a scan to the local map if it is far enough from the newest one in it."""
        T = self.T_odom_end
        since = inverse(self._window[-1][0] if self._window else T) @ T
        if not self._window or np.linalg.norm(since[:3, 3]) > _REACH or angle_of(since) > _REACH:
            self._window = [*self._window, (T, points @ T[:3, :3].T + T[:3, 3])][-_SCANS:]
            self._target = None

    def __getstate__(self) -> dict[str, Any]:
        """The attributes, without what is made when needed."""
        return {**vars(self), "_target": None}
