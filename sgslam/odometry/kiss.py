"""KISS-ICP (Vizzo et al., RA-L 2023) with indoor settings, and a check on each step."""

import logging
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sgslam.config import OdometrySettings
from sgslam.geometry.frames import inverse, squared_up
from sgslam.odometry.base import State
from sgslam.odometry.rigid import Fit, RigidOdometry, end_of, steady_motion
from sgslam.odometry.steps import search

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
_KERNEL = 0.5  # m, of the registration in a search
_NEAR = 0.2  # m; a point this close to the map counts as explained by it
_LEAST = 20  # points that a registration needs
_PATIENCE = 5  # consecutive scans without a registration before a new local map begins


class KissOdometry(RigidOdometry):
    """KISS-ICP with the steps of `KissICP.register_frame`.

    If a step is implausible or leaves most of the scan unexplained, the pose is searched for again from other
    attitudes. A scan that cannot be registered, or has too few points, is lost: it continues the last motion and is not
    added to the local map. After several lost scans a new local map begins.
    """

    def __init__(self, settings: OdometrySettings) -> None:
        from kiss_icp.config import KISSConfig
        from kiss_icp.config.config import DataConfig, MappingConfig, RegistrationConfig
        from kiss_icp.kiss_icp import KissICP

        super().__init__(settings)
        data = DataConfig(max_range=settings.max_range, min_range=settings.min_range, deskew=True)
        mapping = MappingConfig(voxel_size=settings.voxel_size, max_points_per_voxel=settings.voxel_points)
        registration = RegistrationConfig(
            max_num_iterations=settings.iterations, convergence_criterion=settings.convergence, max_num_threads=1
        )  # one thread: the same input gives the same output, and two are no faster
        config = KISSConfig(data=data, mapping=mapping, registration=registration)
        self._kiss = KissICP(config)
        adaptive = config.adaptive_threshold
        self._threshold = _Threshold(adaptive.initial_threshold, adaptive.min_motion_th, settings.max_range)
        self._lost = 0  # consecutive scans without a registration
        # KISS-ICP gives no covariance
        self._covariance = np.diag(np.repeat([settings.other_sigma_rotation, settings.other_sigma_translation], 3) ** 2)

    def _fit(self, points: Floats, point_times: Floats | None, predicted: Floats, seconds: float) -> Fit | None:
        kiss = self._kiss
        times, motion = np.empty(0), steady_motion(predicted, self._velocity, end_of(point_times), point_times)
        if point_times is not None and len(motion.knots) > 1:  # KISS-ICP divides by the scan's duration
            times = point_times
        frame = kiss.preprocessor.preprocess(points, times, inverse(motion.knots[0]) @ predicted)
        if len(frame) < _LEAST:
            return None
        source, for_map = kiss.voxelize(frame)
        fit = self._found(source, predicted)
        self._lost = 0 if fit else self._lost + 1
        if self._lost > _PATIENCE:
            _log.warning("scan %d: the odometry lost track and starts a new local map", self._scans)
            kiss.local_map.clear()
            self._lost = 0
        if not self._lost:
            kiss.local_map.update(for_map, fit.T if fit else predicted)
        return fit

    def _found(self, source: Floats, guess: Floats) -> Fit | None:
        """The registered scan; None where it does not fit the map."""
        settings, map_points = self._settings, self._kiss.local_map.point_cloud().reshape(-1, 3)
        if not len(map_points):
            return Fit(guess, 1.0, np.inf, self._covariance)
        tree = cKDTree(map_points)
        fit = self._at(source, tree, self._align(source, guess, self._threshold.sigma))
        if self._is_sure(fit):
            self._threshold.update(inverse(guess) @ fit.T)
            return fit
        found = search(source, self._last, tree, _NEAR, lambda start: self._align(source, start, _KERNEL), settings)
        return None if found is None else self._at(source, tree, found)

    def _at(self, source: Floats, tree: cKDTree, pose: Floats) -> Fit:
        """How well the points (N, 3) fit the map at a pose (4, 4)."""
        distance, _ = tree.query(source @ pose[:3, :3].T + pose[:3, 3])
        share, residual = float(np.mean(distance < _NEAR)), float(np.minimum(distance, _NEAR).mean())
        return Fit(squared_up(pose), share, residual, self._covariance)

    def _align(self, source: Floats, guess: Floats, sigma: float) -> Floats:
        return self._kiss.registration.align_points_to_map(
            points=source, voxel_map=self._kiss.local_map, initial_guess=guess,
            max_correspondance_distance=3 * sigma, kernel=sigma,
        )  # fmt: skip

    def state(self) -> dict[str, Any]:
        """See `Odometry.state`."""
        return super().state() | {
            "map_points": self._kiss.local_map.point_cloud().reshape(-1, 3), "lost": self._lost,
            "threshold": [self._threshold.squares, self._threshold.count],
        }  # fmt: skip

    def restore(self, state: State) -> None:
        """See `Odometry.restore`."""
        super().restore(state)
        self._kiss.local_map.clear()
        self._kiss.local_map.add_points(np.ascontiguousarray(state["map_points"]))
        self._lost = state["lost"]
        self._threshold.squares, self._threshold.count = state["threshold"]


class _Threshold:
    """KISS-ICP's adaptive threshold (section III-C of its paper) with accessible sums, so that they can be saved."""

    def __init__(self, initial: float, least_motion: float, max_range: float) -> None:
        self._least, self._range = least_motion, max_range
        self.squares, self.count = initial**2, 1.0

    @property
    def sigma(self) -> float:
        """The threshold (m)."""
        return float(np.sqrt(self.squares / self.count))

    def update(self, deviation: Floats) -> None:
        """Adds the deviation (4, 4) of a registration from its prediction."""
        angle = float(np.arccos(np.clip((np.trace(deviation[:3, :3]) - 1) / 2, -1.0, 1.0)))
        error = 2 * self._range * np.sin(angle / 2) + float(np.linalg.norm(deviation[:3, 3]))
        if error > self._least:
            self.squares, self.count = self.squares + error**2, self.count + 1.0
