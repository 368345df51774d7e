"""Runs the system, or its tracker alone, on a folder of scans."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from data.imu import ImuSamples
from data.scans import Scan
from data.trajectory import Trajectory
from sgslam.config import Config
from sgslam.geometry.frames import level_at
from sgslam.odometry.external import ExternalOdometry
from sgslam.session import Result
from sgslam.slam import SceneGraphSlam
from sgslam.tracking import TrackedScan
from sgslam.tracking.run_tracker import CarriedElsewhere, RunTracker, TrackingStep

AddImu = Callable[[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]], None]
_SCAN_NS = 200_000_000  # as long as a scan lasts at most


def run_through(
    slam: SceneGraphSlam, scans: Iterable[Scan], odometry: ExternalOdometry | None = None,
    again: Iterable[Scan] | None = None, samples: ImuSamples | None = None,
) -> Result:  # fmt: skip
    """Adds all scans, with their points' times where they have them, and finishes the run.

    `odometry` replaces that of the run. `again` reads the scans a second time, for a second pass. `samples` are those
    of an IMU. Raises UserError for scans that the odometry does not cover.
    """
    for scan in scans if samples is None else with_samples(scans, samples, slam.add_imu):
        T_odom_sensor = None if odometry is None else odometry.at(scan.stamp_ns)
        slam.add_scan(scan.stamp_ns, scan.points, scan.point_times, T_odom_sensor)
    return slam.finish(again)


@dataclass(frozen=True, eq=False)
class TrackedDrive:
    """All `scans` of a drive as a run without a plan tracks them, in one frame; and how often it believed that the
    sensor had been carried elsewhere. Where it did, a new map began: at the last pose before."""

    scans: list[TrackedScan]
    kidnaps: int

    @property
    def poses(self) -> Trajectory:
        """T_odom_sensor of all scans."""
        stamps = np.array([scan.raw.stamp_ns for scan in self.scans], dtype=np.int64)
        return Trajectory(stamps, np.stack([scan.T_odom_sensor for scan in self.scans]))


def tracked_by_run(scans: Iterable[Scan], config: Config, samples: ImuSamples | None = None) -> TrackedDrive:
    """Tracks all scans, with their points' times where they have them, and with the samples of an IMU where given."""
    tracker = RunTracker(config)
    given = scans if samples is None else with_samples(scans, samples, tracker.add_imu)
    found, T_odom_part, kidnaps = dict[int, TrackedScan](), np.eye(4), 0
    for step in _steps(tracker, given):
        if isinstance(step, CarriedElsewhere):
            kidnaps += 1
            before = [stamp for stamp in found if stamp < step.since_ns]
            T_odom_part = level_at(found[max(before)].T_odom_sensor) if before else np.eye(4)
        else:
            found[step.raw.stamp_ns] = replace(step, T_odom_sensor=T_odom_part @ step.T_odom_sensor)
    return TrackedDrive([found[stamp] for stamp in sorted(found)], kidnaps)


def _steps(tracker: RunTracker, scans: Iterable[Scan]) -> Iterator[TrackingStep]:
    for scan in scans:
        yield from tracker.track(scan.stamp_ns, scan.points, scan.point_times)
    yield from tracker.release()


def with_samples(scans: Iterable[Scan], samples: ImuSamples, add_imu: AddImu) -> Iterator[Scan]:
    """The scans; before each of them the samples until its end, as a run adds them."""
    first = 0
    for scan in scans:
        last = int(np.searchsorted(samples.stamps_ns, scan.stamp_ns + _SCAN_NS, side="right"))
        if last > first:
            add_imu(samples.stamps_ns[first:last], samples.gyro[first:last], samples.accel[first:last])
            first = last
        yield scan
