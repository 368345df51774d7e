"""KISS-SLAM's own command, which is no dependency: it is called where its user has installed it."""

import os
import subprocess
from pathlib import Path

from data.common.errors import UserError

COMMAND = "kiss_slam_pipeline"  # of kiss-slam 0.0.2
# indoors: the odometry's voxels as in `kiss_icp_alone`; small local maps
_SETTINGS = """
odometry:
  preprocessing: {max_range: 100.0, min_range: 0.3, deskew: true}
  registration: {max_num_threads: 1}
  mapping: {voxel_size: 0.3, max_points_per_voxel: 1}
local_mapper: {voxel_size: 0.1, splitting_distance: 3.0}
"""


def kiss_slam_results(command: str, scan_dir: Path, work: Path) -> Path:
    """Runs the command on a folder of scans, in the folder `work`; returns the folder of its results.

    Raises UserError if it fails.
    """
    settings = work / "kiss_slam.yaml"
    settings.write_text(_SETTINGS)
    words = [command, "--dataloader", "generic", "--config", str(settings.resolve()), str(scan_dir.resolve())]
    headless = {**os.environ, "MPLBACKEND": "Agg"}
    done = subprocess.run(words, cwd=work, env=headless, capture_output=True, text=True, check=False)
    if done.returncode:
        last = ((done.stderr or done.stdout).strip() or "no message").splitlines()[-1]
        raise UserError(f"{scan_dir}: {command} failed: {last}")
    return work / "slam_output" / "latest"
