"""Odometry behind one interface: a scan goes in, T_odom_sensor comes out."""

import logging
from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from sgslam.config import OdometrySettings
from sgslam.frames import inverse, squared_up

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
_NEAR = 0.3  # m; a point this close to the map counts as explained
_KERNEL = 0.5  # m, of the registration in a search
_SPACING = 0.25, 0.25  # m and rad between the scans of the local map while others find the steps


class Odometry(Protocol):
    """Anything that tracks the sensor from scan to scan."""

    def register(self, points: Floats, expected_step: Floats | None = None) -> Floats:
        """Takes (N, 3) points of one scan in the sensor frame; returns (4, 4) T_odom_sensor.

        `expected_step` (4, 4) is T_last_sensor as somebody who knows more expects it, as a start of the search.
        """
        ...

    def follow(self, points: Callable[[], Floats], T_last_sensor: Floats) -> Floats:
        """Takes over a step (4, 4) that somebody who knows more has found; returns T_odom_sensor. `points` gives what
        `register` would have been given."""
        ...


class KissOdometry:
    """KISS-ICP (Vizzo et al., RA-L 2023) with an indoor voxel size, and a check on each step.

    A step that no sensor carried through a building makes (it tips over, or leaps) is searched anew, from standing
    still and from turns about the vertical; if nothing fits, the local map is begun afresh where the sensor was last.
    """

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
        self._kiss = KissICP(KISSConfig(data=data, mapping=mapping, registration=registration))
        self._scans = 0
        self._mapped = np.eye(4)  # where the newest scan of the local map was taken

    def register(self, points: Floats, expected_step: Floats | None = None) -> Floats:
        """See `Odometry.register`. The steps are those of `KissICP.register_frame`."""
        kiss = self._kiss
        frame = kiss.preprocessor.preprocess(points, np.empty(0), kiss.last_delta)
        source, for_map = kiss.voxelize(frame)
        sigma = kiss.adaptive_threshold.get_threshold()
        guess = kiss.last_pose @ (kiss.last_delta if expected_step is None else expected_step)
        pose = self._align(source, guess, sigma)
        if self._scans and not self._plausible(pose):
            pose = self._search(source)
            kiss.adaptive_threshold.update_model_deviation(np.eye(4))
        else:
            kiss.adaptive_threshold.update_model_deviation(inverse(guess) @ pose)
        kiss.local_map.update(for_map, pose)
        self._mapped = pose
        kiss.last_delta = inverse(kiss.last_pose) @ pose
        kiss.last_pose = pose
        self._scans += 1
        return pose.copy()

    def follow(self, points: Callable[[], Floats], T_last_sensor: Floats) -> Floats:
        """See `Odometry.follow`. The local map goes on growing, by scans some way apart."""
        kiss = self._kiss
        pose = squared_up(kiss.last_pose @ T_last_sensor)
        since = inverse(self._mapped) @ pose
        if np.linalg.norm(since[:3, 3]) > _SPACING[0] or np.trace(since[:3, :3]) < 1 + 2 * np.cos(_SPACING[1]):
            frame = kiss.preprocessor.preprocess(points(), np.empty(0), kiss.last_delta)
            kiss.local_map.update(kiss.voxelize(frame)[1], pose)
            self._mapped = pose
        kiss.last_delta, kiss.last_pose = T_last_sensor, pose
        self._scans += 1
        return pose.copy()

    def _align(self, source: Floats, guess: Floats, sigma: float) -> Floats:
        return self._kiss.registration.align_points_to_map(
            points=source, voxel_map=self._kiss.local_map, initial_guess=guess,
            max_correspondance_distance=3 * sigma, kernel=sigma,
        )  # fmt: skip

    def _plausible(self, pose: Floats) -> bool:
        last, limits = self._kiss.last_pose, self._settings
        turn = last[:3, :3].T @ pose[:3, :3]
        moved = float(np.linalg.norm(pose[:3, 3] - last[:3, 3]))
        cosine = (turn[0, 0] + turn[1, 1] + turn[2, 2] - 1) / 2
        return moved < limits.max_step and cosine > np.cos(limits.max_turn) and turn[2, 2] > np.cos(limits.max_tip)

    def _search(self, source: Floats) -> Floats:
        """The plausible pose that explains most of the scan, from turns of 30 degrees about the last pose."""
        kiss = self._kiss
        tree = cKDTree(kiss.local_map.point_cloud())
        best, best_share = kiss.last_pose, 0.0
        for turn in np.radians([0, 30, -30, 60, -60, 90, -90, 120, -120, 150, -150, 180]):
            guess = kiss.last_pose.copy()
            guess[:3, :3] = guess[:3, :3] @ Rotation.from_rotvec([0.0, 0.0, turn]).as_matrix()
            pose = self._align(source, guess, _KERNEL)
            step = inverse(kiss.last_pose) @ pose
            if step[2, 2] < np.cos(self._settings.max_tip) or np.linalg.norm(step[:3, 3]) > self._settings.max_step:
                continue
            distance, _ = tree.query(source @ pose[:3, :3].T + pose[:3, 3], distance_upper_bound=_NEAR)
            share = float(np.mean(np.isfinite(distance)))
            if share > best_share + 0.02:
                best, best_share = pose, share
        if best_share < self._settings.min_share:
            _log.warning("scan %d: the odometry lost its track and begins a new local map", self._scans)
            kiss.local_map.clear()
            return kiss.last_pose
        return best
