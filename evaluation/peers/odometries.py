"""Published odometries alone, each with its best settings for indoors."""

import os
import subprocess
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from data.common.errors import UserError
from data.scans import Scan
from data.trajectory import Trajectory
from sgslam.config import OdometrySettings, TrackingSettings

if TYPE_CHECKING:
    from sgslam.odometry.kiss import KissOdometry
    from sgslam.odometry.small_gicp import SmallGicpOdometry

Array = NDArray[np.float64]

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
    """T_odom_sensor of KISS-ICP (Vizzo et al., RA-L 2023) at the ends of the scans, to which they are undistorted where
    their points have times."""
    from sgslam.odometry.kiss import KissOdometry

    return _at_ends(scans, KissOdometry(OdometrySettings(), TrackingSettings()))


def small_gicp_alone(scans: Iterable[Scan]) -> Trajectory:
    """As `kiss_icp_alone`, of small_gicp's GICP (Segal et al., RSS 2009; Koide, JOSS 2024)."""
    from sgslam.odometry.small_gicp import SmallGicpOdometry

    return _at_ends(scans, SmallGicpOdometry(TrackingSettings()))


def _at_ends(scans: Iterable[Scan], odometry: "KissOdometry | SmallGicpOdometry") -> Trajectory:
    poses = dict[int, Array]()
    for scan in scans:
        odometry.locate(scan.stamp_ns, scan.points, scan.point_times)
        poses[scan.stamp_ns] = odometry.T_odom_end
    return Trajectory(np.array([*poses], dtype=np.int64), np.stack([*poses.values()]))


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
