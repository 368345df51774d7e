"""The system's tracker alone, as a run without a plan uses it."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from data.imu import ImuSamples
from data.scans import Scan
from data.trajectory import Trajectory
from sgslam.config import Config
from sgslam.geometry.frames import level_at
from sgslam.tracking import RunTracker
from sgslam.types import TrackedScan

AddImu = Callable[[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]], None]
_SCAN_NS = 200_000_000  # as long as a scan lasts at most


@dataclass(frozen=True, eq=False)
class Tracked:
    """All `scans` of a drive in one frame; and how often the tracker believed that the sensor had been carried
    elsewhere. Where it did, a new map began: at the last pose before."""

    scans: list[TrackedScan]
    kidnaps: int

    @property
    def poses(self) -> Trajectory:
        """T_odom_sensor of all scans."""
        stamps = np.array([scan.raw.stamp_ns for scan in self.scans], dtype=np.int64)
        return Trajectory(stamps, np.stack([scan.T_odom_sensor for scan in self.scans]))


def tracked(scans: Iterable[Scan], samples: ImuSamples | None = None) -> Tracked:
    """Tracks all scans, with their points' times where they have them, and with the samples of an IMU where given."""
    tracker = RunTracker(Config())
    given = scans if samples is None else with_samples(scans, samples, tracker.motion.add_imu)
    found, T_odom_part, kidnaps = dict[int, TrackedScan](), np.eye(4), 0
    for scan in _given_out(tracker, given):
        if scan.begins_elsewhere:
            kidnaps += 1
            T_odom_part = level_at(found[max(found)].T_odom_sensor) if found else np.eye(4)
        found[scan.raw.stamp_ns] = replace(scan, T_odom_sensor=T_odom_part @ scan.T_odom_sensor)
    return Tracked([found[stamp] for stamp in sorted(found)], kidnaps)


def _given_out(tracker: RunTracker, scans: Iterable[Scan]) -> Iterator[TrackedScan]:
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
