"""KISS-ICP (Vizzo et al., RA-L 2023) with an indoor voxel size, and a check on each step."""

import functools
import logging
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from sgslam.config import OdometrySettings
from sgslam.geometry.frames import inverse, squared_up
from sgslam.odometry.base import State
from sgslam.odometry.steps import explained, far_apart, plausible, search

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
_KERNEL = 0.5  # m, of the registration in a search
_NEAR = 0.3  # m; a point this close to the map counts as explained by it
_SPACING = 0.25  # m and rad between the scans of the local map while others find the steps
_SUDDEN = 0.4  # m or rad from the expected step, beyond which the step is checked against the map
_LEAST = 20  # points that a registration needs
_PATIENCE = 5  # consecutive scans without a registration before a new local map begins


class KissOdometry:
    """KISS-ICP with the steps of `KissICP.register_frame`.

    An implausible step (too long, or tipping over), and an unexpected one that leaves most of the scan unexplained, is
    searched again from rotations about the vertical. A scan that cannot be registered, or has too few points, continues
    the last step and is not added to the local map. After several of these a new local map begins.
    """

    upright_only = True  # points of floor and ceiling would drag point-to-point ICP along the scan rings

    def __init__(self, settings: OdometrySettings) -> None:
        from kiss_icp.config import KISSConfig
        from kiss_icp.config.config import DataConfig, MappingConfig, RegistrationConfig
        from kiss_icp.kiss_icp import KissICP

        self._settings = settings
        data = DataConfig(max_range=settings.max_range, min_range=settings.min_range, deskew=False)
        mapping = MappingConfig(voxel_size=settings.voxel_size)
        registration = RegistrationConfig(
            max_num_iterations=settings.iterations, convergence_criterion=settings.convergence, max_num_threads=1
        )  # one thread: the same input gives the same output, and two are no faster
        config = KISSConfig(data=data, mapping=mapping, registration=registration)
        self._kiss = KissICP(config)
        adaptive = config.adaptive_threshold
        self._threshold = _Threshold(adaptive.initial_threshold, adaptive.min_motion_th, settings.max_range)
        self._lost, self._scans = 0, 0  # consecutive scans without a registration, and all scans
        self._mapped = np.eye(4)  # pose of the newest scan in the local map

    def register(self, points: Floats, expected_step: Floats | None = None) -> Floats:
        """See `Odometry.register`."""
        kiss = self._kiss
        frame = kiss.preprocessor.preprocess(points, np.empty(0), kiss.last_delta)
        pose = kiss.last_pose @ (kiss.last_delta if expected_step is None else expected_step)
        if len(frame) >= _LEAST:
            source, for_map = kiss.voxelize(frame)
            found = self._found(source, pose)
            self._lost = 0 if found is not None else self._lost + 1
            if self._lost > _PATIENCE:
                _log.warning("scan %d: the odometry lost its track and begins a new local map", self._scans)
                kiss.local_map.clear()
                self._lost = 0
            pose = pose if found is None else found
            if not self._lost:
                kiss.local_map.update(for_map, pose)
                self._mapped = pose
        kiss.last_delta = inverse(kiss.last_pose) @ pose
        kiss.last_pose = pose
        self._scans += 1
        return pose.copy()

    def follow(self, points: Callable[[], Floats], T_last_sensor: Floats) -> Floats:
        """See `Odometry.follow`. The local map still grows by spaced scans."""
        kiss = self._kiss
        pose = squared_up(kiss.last_pose @ T_last_sensor)
        if far_apart(self._mapped, pose, _SPACING):
            frame = kiss.preprocessor.preprocess(points(), np.empty(0), kiss.last_delta)
            kiss.local_map.update(kiss.voxelize(frame)[1], pose)
            self._mapped = pose
        kiss.last_delta, kiss.last_pose = T_last_sensor, pose
        self._scans += 1
        return pose.copy()

    def state(self) -> dict[str, Floats]:
        """See `Odometry.state`."""
        kiss = self._kiss
        return {
            "map_points": kiss.local_map.point_cloud().reshape(-1, 3), "mapped": self._mapped.copy(),
            "last_pose": np.array(kiss.last_pose), "last_delta": np.array(kiss.last_delta),
            "threshold": np.array([self._threshold.squares, self._threshold.count]),
            "lost": np.array([self._lost], float), "scans": np.array([self._scans], float),
        }  # fmt: skip

    def restore(self, state: State) -> None:
        """See `Odometry.restore`."""
        kiss = self._kiss
        kiss.local_map.clear()
        kiss.local_map.add_points(np.ascontiguousarray(state["map_points"]))
        kiss.last_pose, kiss.last_delta = np.array(state["last_pose"]), np.array(state["last_delta"])
        self._mapped = np.array(state["mapped"])
        self._threshold.squares, self._threshold.count = (float(value) for value in state["threshold"])
        self._lost, self._scans = int(state["lost"][0]), int(state["scans"][0])

    def _align(self, source: Floats, guess: Floats, sigma: float) -> Floats:
        return self._kiss.registration.align_points_to_map(
            points=source, voxel_map=self._kiss.local_map, initial_guess=guess,
            max_correspondance_distance=3 * sigma, kernel=sigma,
        )  # fmt: skip

    def _found(self, source: Floats, guess: Floats) -> Floats | None:
        """T_odom_sensor (4, 4) of the registered scan; None where it does not fit the map."""
        kiss, settings = self._kiss, self._settings
        pose = self._align(source, guess, self._threshold.sigma)
        if not self._scans:
            return pose
        likely = plausible(inverse(kiss.last_pose) @ pose, settings)
        if likely and not far_apart(guess, pose, _SUDDEN):
            self._threshold.update(inverse(guess) @ pose)
            return pose
        map_points = kiss.local_map.point_cloud().reshape(-1, 3)
        if likely and len(map_points) and explained(source, pose, cKDTree(map_points), _NEAR) >= settings.min_share:
            self._threshold.update(inverse(guess) @ pose)
            return pose
        align = functools.partial(self._align, source, sigma=_KERNEL)
        return search(source, kiss.last_pose, map_points, _NEAR, align, settings)


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
