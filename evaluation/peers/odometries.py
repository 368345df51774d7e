"""Published odometries alone, each with its best settings for indoors."""

import os
import subprocess
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.scans import Scan
from data.trajectory import Trajectory
from sgslam.geometry.frames import inverse, squared_up
from sgslam.odometry.rigid import steady_motion
from sgslam.odometry.steps import far_apart
from sgslam.registration.motion_prior import velocity_between

Array = NDArray[np.float64]

# KISS-ICP; its defaults of 1 m and 20 points are for streets. Of the least error in two drives (demo building, office)
# with other seeds than the reported ones, of 24 settings.
VOXEL_M, POINTS_PER_VOXEL = 0.3, 1
# small_gicp, chosen likewise: points are thinned out to this distance, correspondences at most so far apart; the local
# map has so many scans, so far apart (m or rad)
DOWNSAMPLED_M, REACH_M, LOCAL_SCANS, SPACING = 0.25, 0.3, 15, 0.3
DESKEWING_ROUNDS = 3  # a scan deskewed by the step before it, and only once, diverges

KISS_SLAM = "kiss_slam_pipeline"  # the command of kiss-slam 0.0.2, which is no dependency: its user has installed it
# indoors: the odometry's voxels as in `kiss_icp_alone`; small local maps
KISS_SLAM_SETTINGS = """
odometry:
  preprocessing: {max_range: 100.0, min_range: 0.3, deskew: true}
  registration: {max_num_threads: 1}
  mapping: {voxel_size: 0.3, max_points_per_voxel: 1}
local_mapper: {voxel_size: 0.1, splitting_distance: 3.0}
"""


def kiss_icp_alone(scans: Iterable[Scan]) -> Trajectory:
    """T_odom_sensor of KISS-ICP (Vizzo et al., RA-L 2023) on whole scans, deskewed to their ends where their points
    have times."""
    from kiss_icp.config import KISSConfig
    from kiss_icp.config.config import DataConfig, MappingConfig, RegistrationConfig
    from kiss_icp.kiss_icp import KissICP

    mapping = MappingConfig(voxel_size=VOXEL_M, max_points_per_voxel=POINTS_PER_VOXEL)
    registration = RegistrationConfig(max_num_threads=1)
    kiss = KissICP(KISSConfig(data=DataConfig(), mapping=mapping, registration=registration))

    def register(scan: Scan) -> Array:
        kiss.register_frame(scan.points, np.empty(0) if scan.point_times is None else scan.point_times)
        return kiss.last_pose.copy()

    return _trajectory(scans, register)


def small_gicp_alone(scans: Iterable[Scan]) -> Trajectory:
    """T_odom_sensor of small_gicp's GICP (Segal et al., RSS 2009; Koide, JOSS 2024) on whole scans, with a constant
    velocity, against a local map of the last spaced scans.

    Scans whose points have times are deskewed to their ends, by the step that was just found, several times over.
    """
    import small_gicp

    T, step, stamp_ns = np.eye(4), np.eye(4), 0
    kept: list[tuple[Array, Array]] = []  # pose and points (N, 3), odometry frame, of the scans of the local map
    target: tuple[Any, Any] | None = None

    def register(scan: Scan) -> Array:
        """T_odom_sensor of the next scan, which joins the local map where it is far enough from the last one."""
        nonlocal T, step, stamp_ns, kept, target
        interval_s, before, T = (scan.stamp_ns - stamp_ns) / 1e9, T, T @ step
        for _ in range(1 if scan.point_times is None else DESKEWING_ROUNDS):
            points = scan.points if target is None else _at_the_end(scan, step, interval_s)
            source, _ = small_gicp.preprocess_points(points, downsampling_resolution=DOWNSAMPLED_M)
            if target is None:
                break
            cloud, tree = target
            found = small_gicp.align(
                cloud, source, tree, T, registration_type="GICP", max_correspondence_distance=REACH_M
            )
            T = squared_up(found.T_target_source)
            step = inverse(before) @ T
        stamp_ns = scan.stamp_ns
        if not kept or far_apart(kept[-1][0], T, SPACING):
            points = source.points()[:, :3] @ T[:3, :3].T + T[:3, 3]
            kept = [*kept, (T, points)][-LOCAL_SCANS:]
            stacked = np.concatenate([points for _, points in kept])
            target = small_gicp.preprocess_points(stacked, downsampling_resolution=DOWNSAMPLED_M)
        return T.copy()

    return _trajectory(scans, register)


def _at_the_end(scan: Scan, step: Array, interval_s: float) -> Array:
    """(N, 3) the points in the sensor frame at the scan's end, for a sensor that makes `step` (4, 4) in `interval_s`;
    as they are if they have no times."""
    times = scan.point_times
    if times is None:
        return scan.points
    velocity = velocity_between(np.eye(4), step, interval_s)
    placed = steady_motion(step, velocity, float(times.max()), times).placed(scan.points, times)
    return np.asarray((placed - step[:3, 3]) @ step[:3, :3])


def _trajectory(scans: Iterable[Scan], register: Callable[[Scan], Array]) -> Trajectory:
    found = [(scan.stamp_ns, register(scan)) for scan in scans]
    return Trajectory(np.array([stamp for stamp, _ in found], dtype=np.int64), np.stack([pose for _, pose in found]))


def kiss_slam_results(scan_dir: Path, work: Path) -> Path:
    """Runs KISS-SLAM's command on a folder of scans, in the folder `work`; returns the folder of its results.

    Raises UserError if it fails.
    """
    settings = work / "kiss_slam.yaml"
    settings.write_text(KISS_SLAM_SETTINGS)
    words = [KISS_SLAM, "--dataloader", "generic", "--config", str(settings.resolve()), str(scan_dir.resolve())]
    headless = {**os.environ, "MPLBACKEND": "Agg"}
    done = subprocess.run(words, cwd=work, env=headless, capture_output=True, text=True, check=False)
    if done.returncode:
        last = ((done.stderr or done.stdout).strip() or "no message").splitlines()[-1]
        raise UserError(f"{scan_dir}: {KISS_SLAM} failed: {last}")
    return work / "slam_output" / "latest"
