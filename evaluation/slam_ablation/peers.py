"""Published odometries alone, each with its best settings for indoors."""

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

import numpy as np

from data.common.errors import UserError
from data.scans import Scan
from data.trajectory import Trajectory
from sgslam.config import OdometrySettings

VOXEL_M = 0.5  # for KISS-ICP; its default of 1 m is for streets

_PIPELINE = """
import json, sys, time
from pathlib import Path
from kiss_icp.datasets import dataset_factory
from kiss_icp.pipeline import OdometryPipeline
used = time.process_time()
OdometryPipeline(dataset_factory(dataloader="generic", data_dir=Path(sys.argv[1]))).run()
Path(sys.argv[2]).write_text(json.dumps(time.process_time() - used))
"""


def kiss_icp_alone(scans: Iterable[Scan]) -> Trajectory:
    """T_odom_sensor of KISS-ICP (Vizzo et al., RA-L 2023) on whole scans, deskewed where their points have times."""
    from kiss_icp.config import KISSConfig
    from kiss_icp.config.config import DataConfig, MappingConfig, RegistrationConfig
    from kiss_icp.kiss_icp import KissICP

    mapping, registration = MappingConfig(voxel_size=VOXEL_M), RegistrationConfig(max_num_threads=1)
    kiss = KissICP(KISSConfig(data=DataConfig(), mapping=mapping, registration=registration))
    stamps, poses = [], []
    for scan in scans:
        kiss.register_frame(scan.points, np.empty(0) if scan.point_times is None else scan.point_times)
        stamps.append(scan.stamp_ns)
        poses.append(kiss.last_pose.copy())
    return Trajectory(np.array(stamps, dtype=np.int64), np.stack(poses))


def small_gicp_alone(scans: Iterable[Scan]) -> Trajectory:
    """T_odom_sensor of small_gicp (Koide, JOSS 2024) on whole scans."""
    from sgslam.odometry.small_gicp import SmallGicpOdometry

    odometry = SmallGicpOdometry(OdometrySettings())
    stamps, poses = [], []
    for scan in scans:
        stamps.append(scan.stamp_ns)
        poses.append(odometry.register(scan.points))
    return Trajectory(np.array(stamps, dtype=np.int64), np.stack(poses))


def cpu_seconds_of_kiss_icp(scan_dir: Path) -> float:
    """CPU seconds, of all threads, of KISS-ICP's own pipeline in its default configuration: reading, odometry, results.

    Raises UserError if it fails.
    """
    with tempfile.TemporaryDirectory() as folder:
        answer = Path(folder) / "seconds"
        command = [sys.executable, "-c", _PIPELINE, str(scan_dir.resolve()), str(answer)]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        if done.returncode:
            last = (done.stderr.strip() or "no message").splitlines()[-1]
            raise UserError(f"{scan_dir}: KISS-ICP's pipeline failed: {last}")
        return float(json.loads(answer.read_text()))
