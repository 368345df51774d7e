"""Generalized ICP (Segal et al., RSS 2009) of small_gicp (Koide, JOSS 2024) against a window of earlier scans."""

import logging
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from data.common.errors import UserError
from sgslam.config import OdometrySettings
from sgslam.geometry.frames import squared_up
from sgslam.odometry.base import State
from sgslam.odometry.rigid import Fit, RigidOdometry, end_of, steady_motion
from sgslam.odometry.steps import far_apart, search
from sgslam.registration.motion_prior import velocity_between

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
_NEIGHBOURS = 10  # points that a surface is fitted to
_LEAST = 20  # points that a registration needs
_NEAR = 0.15  # m; a point this close to the map counts as explained by it
_PATIENCE = 5  # consecutive scans without a registration before a new local map begins
_ROUNDS = 3  # of deskewing; a scan deskewed by the step before it, and only once, diverges
_STAYS = 1e-3  # m and rad, change of the pose from round to round


class SmallGicpOdometry(RigidOdometry):
    """Registers each scan, deskewed by the step that is found, to a local map of spaced scans.

    With all scans in it, a standing robot would fill it with noise (3.9 m of error after 80 still scans). Runs on one
    thread, so that the same input gives the same output.
    """

    _STATE = (*RigidOdometry._STATE, "_mapped", "_window", "_lost")

    def __init__(self, settings: OdometrySettings) -> None:
        try:
            import small_gicp
        except ImportError:
            raise UserError("odometry small_gicp: the library is not installed; pip install small_gicp") from None
        super().__init__(settings)
        self._gicp, self._mapped = small_gicp, np.eye(4)
        self._window: list[Floats] = []  # points (N, 3) of each scan in the local map, odometry frame
        self._target: Any = None  # the map in small_gicp's form with its search tree, built on demand
        self._lost = 0  # consecutive scans without a registration

    def _fit(self, points: Floats, point_times: Floats | None, predicted: Floats, seconds: float) -> Fit | None:
        fit, source = self._deskewed_fit(points, point_times, predicted, seconds)
        if source is None:
            return None
        self._lost = 0 if fit else self._lost + 1
        if self._lost > _PATIENCE:
            _log.warning("scan %d: the odometry lost track and starts a new local map", self._scans)
            self._window, self._lost = [], 0
        if not self._lost:
            self._grow(source.points()[:, :3], fit.T if fit else predicted)
        if fit is None or not seconds:
            return fit
        # a motion prior bounds what no surface constrains
        prior = np.linalg.inv(self._drift(self._unseen + seconds))
        return replace(fit, covariance=np.linalg.inv(np.linalg.inv(fit.covariance) + prior))

    def _deskewed_fit(
        self, points: Floats, point_times: Floats | None, predicted: Floats, seconds: float
    ) -> tuple[Fit | None, Any]:
        """The fit, and the points deskewed by it, None where they are too few; deskewed again until the pose stays."""
        pose, velocity = predicted, self._velocity
        for _ in range(1 if point_times is None else _ROUNDS):
            source = self._prepared(points, point_times, pose, velocity)
            if source is None:
                return None, None
            if not self._window:
                return Fit(predicted, 1.0, np.inf, self._drift(0.0)), source
            fit = self._found(source, pose)
            if fit is None or not far_apart(pose, fit.T, _STAYS):
                break
            pose, velocity = fit.T, velocity_between(self._last, fit.T, seconds)
        return fit, source

    def _prepared(self, points: Floats, point_times: Floats | None, pose: Floats, velocity: Floats) -> Any:
        """The points within range, deskewed to the scan's end, downsampled, with covariances; None for too few."""
        distance = np.linalg.norm(points, axis=1)
        within = (distance > self._settings.min_range) & (distance < self._settings.max_range)
        kept = points[within]
        if len(kept) < _LEAST:
            return None
        if point_times is not None:
            motion = steady_motion(pose, velocity, end_of(point_times), point_times)
            in_odom = motion.placed(kept, point_times[within])
            kept = (in_odom - pose[:3, 3]) @ pose[:3, :3]
        cloud, _ = self._gicp.preprocess_points(
            kept, downsampling_resolution=self._settings.gicp_voxel_size, num_neighbors=_NEIGHBOURS, num_threads=1
        )
        return cloud if cloud.size() >= _LEAST else None

    def _found(self, source: Any, guess: Floats) -> Fit | None:
        """The registered scan where the map explains enough of it; else None."""
        fit = self._align(source, guess)
        if self._is_sure(fit):
            return fit
        points = np.ascontiguousarray(source.points()[:, :3])
        tree = cKDTree(np.concatenate(self._window))

        def align(start: Floats) -> Floats:
            found = self._align(source, start)
            return start if found is None else found.T

        best = search(points, self._last, tree, _NEAR, align, self._settings)
        return None if best is None else self._align(source, best)

    def _align(self, source: Any, guess: Floats) -> Fit | None:
        """The scan registered from a guess; None where that fails."""
        if self._target is None:
            self._target = self._gicp.preprocess_points(
                np.concatenate(self._window), downsampling_resolution=self._settings.gicp_voxel_size,
                num_neighbors=_NEIGHBOURS, num_threads=1,
            )  # fmt: skip
        target, tree = self._target
        found = self._gicp.align(
            target, source, tree, init_T_target_source=guess, registration_type="GICP",
            max_correspondence_distance=self._settings.gicp_reach, num_threads=1,
            max_iterations=self._settings.iterations,
        )  # fmt: skip
        if found.num_inliers < _LEAST or not np.isfinite(found.T_target_source).all():
            return None
        # its Hessian is in the sensor's axes, rotation first; its error in standard deviations
        covariance = np.linalg.pinv(np.array(found.H), hermitian=True)
        residual = float(np.sqrt(2 * found.error / found.num_inliers))
        return Fit(squared_up(np.array(found.T_target_source)), found.num_inliers / source.size(), residual, covariance)

    def _grow(self, points: Floats, pose: Floats) -> None:
        """Adds a scan to the local map if it is far enough from the last one in it."""
        if self._window and not far_apart(self._mapped, pose, self._settings.gicp_spacing):
            return
        moved = points @ pose[:3, :3].T + pose[:3, 3]
        self._window = [*self._window, moved][-self._settings.gicp_scans :]
        self._target, self._mapped = None, pose

    def restore(self, state: State) -> None:
        """See `Odometry.restore`."""
        super().restore(state)
        self._target = None
