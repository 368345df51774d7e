"""Runs the system on a folder of scans."""

from collections.abc import Iterable

from data.scans import Scan
from sgslam.odometry.external import ExternalOdometry
from sgslam.session import Result
from sgslam.slam import SceneGraphSlam


def run_through(slam: SceneGraphSlam, scans: Iterable[Scan], odometry: ExternalOdometry | None = None) -> Result:
    """Adds all scans, with their points' times where they have them, and finishes the run.

    `odometry` replaces that of the run. Raises UserError for scans that it does not cover.
    """
    for scan in scans:
        T_odom_sensor = None if odometry is None else odometry.at(scan.stamp_ns)
        slam.add_scan(scan.stamp_ns, scan.points, scan.point_times, T_odom_sensor)
    return slam.finish()
