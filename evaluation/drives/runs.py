"""Runs the system on a folder of scans."""

from collections.abc import Iterable

from data.scans import Scan
from sgslam.session import Result
from sgslam.slam import SceneGraphSlam


def run_through(slam: SceneGraphSlam, scans: Iterable[Scan]) -> Result:
    """Adds all scans, with their points' times where they have them, and finishes the run."""
    for scan in scans:
        slam.add_scan(scan.stamp_ns, scan.points, scan.point_times)
    return slam.finish()
