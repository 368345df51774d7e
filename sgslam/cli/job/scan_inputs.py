"""What a run tracks: its scans and settings, poses of another odometry, an IMU."""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from data.common.errors import UserError
from data.imu import ImuSamples, read_imu
from data.scans import Scan, ScanSource
from data.scans.point_times import Stamped
from data.scans.sources import open_scans
from sgslam.cli.job.arguments import out_folder, read_config, read_start, with_stamp
from sgslam.cli.job.resume_arguments import restore_arguments
from sgslam.config import Config
from sgslam.odometry.external import ExternalOdometry
from sgslam.perception.scan_checks import in_metres_and_sensor_frame


class PassedScans(ScanSource):
    """Stands for the scans of a source that another process reads; `path` is that of the source."""

    def __init__(self, path: Path, count: int = 0) -> None:
        super().__init__()
        self.path, self._count = path, count

    @classmethod
    def of(cls, scans: ScanSource) -> "PassedScans":
        """Those of a source."""
        own = cls(scans.path, len(scans))
        own.note, own.stamps_ns, own.given = scans.note, scans.stamps_ns, scans.given
        own.stamped, own.is_dense = scans.stamped, scans.is_dense
        return own

    def __len__(self) -> int:
        return self._count

    def _jobs(self) -> Iterator[Callable[[], Scan]]:
        return iter(())


@dataclass(frozen=True, eq=False)
class ScanInputs:
    """`resumed_from` is the state header of the run to resume; it, `external_odometry` and `imu` are None without one.
    `imu_digest` identifies the samples."""

    resumed_from: dict[str, Any] | None
    config: Config
    scans: ScanSource
    external_odometry: ExternalOdometry | None = None
    imu: ImuSamples | None = None
    imu_digest: str | None = None

    @property
    def is_passed(self) -> bool:
        """Whether another process reads and tracks the scans."""
        return isinstance(self.scans, PassedScans)

    def passed(self) -> "ScanInputs":
        """What a process is told that does not read the scans."""
        return replace(self, scans=PassedScans.of(self.scans), external_odometry=None, imu=None)


def read_scan_inputs(options: argparse.Namespace) -> ScanInputs:
    """Reads what the options name; missing ones are taken from the resumed run or the demo. Raises UserError."""
    resumed = None if options.resume is None else restore_arguments(options)
    config, external = read_config(options, resumed)
    if options.start is not None:
        read_start(options.start)
    if options.demo:
        _make_demo(options)
    scans = _open_scans(options, config.tracking.stamp)
    if config.tracking.stamp == "auto":
        config = with_stamp(config, scans.stamped)
    next(in_metres_and_sensor_frame(scans), None)  # wrong ones are refused before the output folder is touched
    if not scans.is_dense:  # too far apart to be registered
        config = config.model_copy(update={"odometry": config.odometry.model_copy(update={"given": "exact"})})
    imu = None if options.imu is None else read_imu(options.imu, options.imu_topic)
    if external is not None and scans.stamps_ns is not None:
        external.check(scans.stamps_ns)
    return ScanInputs(resumed, config, scans, external, imu, None if imu is None else imu.digest())


def _open_scans(options: argparse.Namespace, stamped: Stamped) -> ScanSource:
    if options.slam_output is None:
        return open_scans(options.scan_dir, options.topic, stamped)
    from data.slam_output import open_slam_output

    return open_slam_output(
        options.slam_output, options.scan_dir, options.topic, options.cloud, options.times, stamped
    )  # fmt: skip


def _make_demo(options: argparse.Namespace) -> None:
    from sgslam.cli.job.demo import make_demo  # imports the simulator, which only the demo needs

    if options.scan_dir is not None or options.bim is not None:
        raise UserError("--demo brings its own scans and building; leave out --scan-dir and --bim")
    make_demo(options, out_folder(options))
