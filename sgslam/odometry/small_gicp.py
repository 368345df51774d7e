"""Generalized ICP (Segal et al., RSS 2009) of small_gicp (Koide, JOSS 2024) against a window of earlier scans."""

import logging
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from sgslam.config import OdometrySettings
from sgslam.geometry.frames import inverse, squared_up
from sgslam.odometry.base import State
from sgslam.odometry.steps import far_apart, plausible, search

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
_NEIGHBOURS = 10  # points that a surface is fitted to
_LEAST = 20  # points that a registration needs
_REACH = 0.5  # m between corresponding points
_NEAR = 0.15  # m; a point this close to the map counts as explained by it
_PATIENCE = 5  # consecutive scans without a registration before a new local map begins


class SmallGicpOdometry:
    """Registers each scan to a local map of spaced scans.

    With all scans in it, a standing robot would fill it with noise (3.9 m of error after 80 still scans). Runs on one
    thread, so that the same input gives the same output.
    """

    upright_only = False  # the floor is needed to constrain the height

    def __init__(self, settings: OdometrySettings) -> None:
        try:
            import small_gicp
        except ImportError:
            raise UserError("odometry small_gicp: the library is not there; pip install small_gicp") from None
        self._gicp, self._settings = small_gicp, settings
        self._last, self._delta, self._mapped = np.eye(4), np.eye(4), np.eye(4)
        self._window: list[Floats] = []  # points (N, 3) of each scan in the local map, odometry frame
        self._target: Any = None  # the map in small_gicp's form with its search tree, built on demand
        self._lost, self._scans = 0, 0  # consecutive scans without a registration, and all scans

    def register(self, points: Floats, expected_step: Floats | None = None) -> Floats:
        """See `Odometry.register`."""
        guess = squared_up(self._last @ (self._delta if expected_step is None else expected_step))
        source = self._prepared(points)
        pose = guess if self._window else self._last
        if source is not None:
            found = self._found(source, guess) if self._window else pose
            self._lost = 0 if found is not None else self._lost + 1
            if self._lost > _PATIENCE:
                _log.warning("scan %d: the odometry lost its track and begins a new local map", self._scans)
                self._window, self._lost = [], 0
            pose = guess if found is None else found
            if not self._lost:
                self._grow(source.points()[:, :3], pose)
        self._delta, self._last = inverse(self._last) @ pose, pose
        self._scans += 1
        return pose.copy()

    def follow(self, points: Callable[[], Floats], T_last_sensor: Floats) -> Floats:
        """See `Odometry.follow`."""
        pose = squared_up(self._last @ T_last_sensor)
        if not self._window or far_apart(self._mapped, pose, self._settings.gicp_spacing):
            source = self._prepared(points())
            if source is not None:
                self._grow(source.points()[:, :3], pose)
        self._delta, self._last = T_last_sensor, pose
        self._scans += 1
        return pose.copy()

    def state(self) -> dict[str, Floats]:
        """See `Odometry.state`."""
        points = np.concatenate([np.empty((0, 3)), *self._window])
        return {
            "map_points": points, "points_of_scan": np.array([len(p) for p in self._window], float),
            "mapped": self._mapped.copy(), "last_pose": self._last.copy(), "last_delta": self._delta.copy(),
            "lost": np.array([self._lost], float), "scans": np.array([self._scans], float),
        }  # fmt: skip

    def restore(self, state: State) -> None:
        """See `Odometry.restore`."""
        ends = np.cumsum(state["points_of_scan"]).astype(int)[:-1]
        self._window = np.split(np.array(state["map_points"]), ends) if len(state["points_of_scan"]) else []
        self._target = None
        self._mapped, self._last = np.array(state["mapped"]), np.array(state["last_pose"])
        self._delta = np.array(state["last_delta"])
        self._lost, self._scans = int(state["lost"][0]), int(state["scans"][0])

    def _prepared(self, points: Floats) -> Any:
        """The points within range, downsampled, with covariances; None where there are too few."""
        distance = np.linalg.norm(points, axis=1)
        kept = points[(distance > self._settings.min_range) & (distance < self._settings.max_range)]
        if len(kept) < _LEAST:
            return None
        cloud, _ = self._gicp.preprocess_points(
            kept, downsampling_resolution=self._settings.gicp_voxel_size, num_neighbors=_NEIGHBOURS, num_threads=1
        )
        return cloud if cloud.size() >= _LEAST else None

    def _found(self, source: Any, guess: Floats) -> Floats | None:
        """T_odom_sensor (4, 4) where the map explains enough of the scan, else None."""
        pose, share = self._align(source, guess)
        if share >= self._settings.min_share and plausible(inverse(self._last) @ pose, self._settings):
            return pose
        points = np.ascontiguousarray(source.points()[:, :3])
        map_points = np.concatenate(self._window)
        return search(
            points, self._last, map_points, _NEAR, lambda start: self._align(source, start)[0], self._settings
        )

    def _align(self, source: Any, guess: Floats) -> tuple[Floats, float]:
        """T_odom_sensor (4, 4) registered from a guess, and the share of inliers; (guess, 0) where that fails."""
        if self._target is None:
            self._target = self._gicp.preprocess_points(
                np.concatenate(self._window), downsampling_resolution=self._settings.gicp_voxel_size,
                num_neighbors=_NEIGHBOURS, num_threads=1,
            )  # fmt: skip
        target, tree = self._target
        found = self._gicp.align(
            target, source, tree, init_T_target_source=guess, registration_type="GICP",
            max_correspondence_distance=_REACH, num_threads=1, max_iterations=self._settings.iterations,
        )  # fmt: skip
        if found.num_inliers < _LEAST or not np.isfinite(found.T_target_source).all():
            return guess, 0.0
        return squared_up(np.array(found.T_target_source)), found.num_inliers / source.size()

    def _grow(self, points: Floats, pose: Floats) -> None:
        """Adds a scan to the local map if it is far enough from the last one in it."""
        if self._window and not far_apart(self._mapped, pose, self._settings.gicp_spacing):
            return
        moved = points @ pose[:3, :3].T + pose[:3, 3]
        self._window = [*self._window, moved][-self._settings.gicp_scans :]
        self._target, self._mapped = None, pose
