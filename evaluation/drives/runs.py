"""Runs the system, or its tracker alone, on a folder of scans."""

from collections.abc import Iterable, Iterator

from data.scans import Scan
from sgslam.config import Config
from sgslam.odometry import make_odometry
from sgslam.odometry.external import ExternalOdometry
from sgslam.perception import RawScan, checked_scan
from sgslam.session import Result
from sgslam.slam import SceneGraphSlam
from sgslam.tracking import ScanTracker, TrackedScan


def run_through(slam: SceneGraphSlam, scans: Iterable[Scan], odometry: ExternalOdometry | None = None) -> Result:
    """Adds all scans, with their points' times where they have them, and finishes the run.

    `odometry` replaces that of the run. Raises UserError for scans that it does not cover.
    """
    for scan in scans:
        T_odom_sensor = None if odometry is None else odometry.at(scan.stamp_ns)
        slam.add_scan(scan.stamp_ns, scan.points, scan.point_times, T_odom_sensor)
    return slam.finish()


def tracked_through(tracker: ScanTracker, scans: Iterable[Scan]) -> Iterator[TrackedScan]:
    """All scans as a run tracks them, with their points' times where they have them; those of the first seconds come
    together, once it is known where up is."""
    for scan in scans:
        points = checked_scan(scan.stamp_ns, scan.points, None, None)
        yield from tracker.track(RawScan(scan.stamp_ns, points, scan.point_times, None))
    yield from tracker.release()


def tracker_of_run(config: Config) -> ScanTracker:
    """The tracker of a run with these settings, odometry included."""
    return ScanTracker(config, make_odometry(config.odometry, config.tracking))
