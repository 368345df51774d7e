"""Runs the system, or its tracker alone, on a folder of scans."""

from collections.abc import Iterable, Iterator

import numpy as np

from data.imu import ImuSamples
from data.scans import Scan
from sgslam.config import Config
from sgslam.inertial import ImuBuffer
from sgslam.odometry import make_odometry
from sgslam.odometry.external import ExternalOdometry
from sgslam.perception import RawScan, checked_scan
from sgslam.session import Result
from sgslam.slam import SceneGraphSlam
from sgslam.tracking import ScanTracker, TrackedScan

_SCAN_NS = 200_000_000  # as long as a scan lasts at most


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


def tracker_of_run(config: Config, imu: ImuBuffer | None = None) -> ScanTracker:
    """The tracker of a run with these settings, odometry included; `imu` gets samples as `with_samples` adds them."""
    return ScanTracker(config, make_odometry(config.odometry, config.tracking, imu), imu)


def with_samples(scans: Iterable[Scan], samples: ImuSamples, imu: ImuBuffer) -> Iterator[Scan]:
    """The scans; before each of them the samples until its end, as a run adds them."""
    first = 0
    for scan in scans:
        last = int(np.searchsorted(samples.stamps_ns, scan.stamp_ns + _SCAN_NS, side="right"))
        if last > first:
            imu.add(ImuSamples(samples.stamps_ns[first:last], samples.gyro[first:last], samples.accel[first:last]))
            first = last
        yield scan
