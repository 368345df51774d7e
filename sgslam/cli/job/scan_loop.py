"""The scan loop of a run: adds the scans one by one, writes checkpoints, and stops cleanly when interrupted."""

import gc
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from time import perf_counter
from types import FrameType
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from data import UserError
from data.imu import ImuSamples
from sgslam.cli.job.inputs import RunInputs
from sgslam.session import Checkpoints, Update
from sgslam.session.checkpoints import Resumable
from sgslam.slam import SceneGraphSlam

Floats = NDArray[np.float64]
_SCAN_NS = 200_000_000  # as long as a scan lasts at most, from its stamp on

ScanCallback: TypeAlias = Callable[[SceneGraphSlam, Update, Floats], None]


class TakesScans(Resumable, Protocol):
    """`SceneGraphSlam`, or what takes its place where another process builds the map."""

    @property
    def newest_imu_ns(self) -> int | None:
        """The stamp of the newest IMU sample; None before the first."""
        ...

    def add_scan(
        self,
        stamp_ns: int,
        points: Floats,
        point_times: Floats | None,
        T_odom_sensor: Floats | None,
        step_covariance: Floats | None,
        /,
    ) -> Any:
        """See `SceneGraphSlam.add_scan`."""
        ...

    def add_imu(self, stamp_ns: NDArray[np.int64], gyro: Floats, accel: Floats, /) -> None:
        """See `SceneGraphSlam.add_imu`."""
        ...


@dataclass
class Progress:
    """The progress of a run: `index` of the newest scan, the number of scans `fed` to it, the `seconds` spent on
    reading scans and writing checkpoints, and the `warnings` that it printed."""

    index: int = -1
    fed: int = 0
    seconds: dict[str, float] = field(default_factory=lambda: {"reading": 0.0, "checkpoints": 0.0})
    warnings: list[str] = field(default_factory=list)


class Interruption:
    """True once the user (Ctrl-C) or the system (SIGTERM) has requested the process to end."""

    def __init__(self) -> None:
        self._requested = False

    def __bool__(self) -> bool:
        """Whether the end was requested."""
        return self._requested

    def request(self, number: int, frame: FrameType | None) -> None:
        """Signal handler. The second request raises KeyboardInterrupt."""
        if self._requested:
            raise KeyboardInterrupt
        self._requested = True


@contextmanager
def interruptible() -> Iterator[Interruption]:
    """Context that defers SIGINT and SIGTERM, so that no scan is left half processed."""
    interruption = Interruption()
    if threading.current_thread() is not threading.main_thread():
        yield interruption
        return
    before = {number: signal.signal(number, interruption.request) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield interruption
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def run_scans(
    slam: TakesScans,
    inputs: RunInputs,
    progress: Progress,
    checkpoints: Checkpoints,
    on_scan: Sequence[ScanCallback] = (),
) -> str | None:
    """Adds the scans after `progress.index` and updates `progress`; returns the reason if it stops early, else None.

    `on_scan` are called after each scan, where this process builds the map. Raises UserError if not even one scan could
    be added, and KeyboardInterrupt at the second interrupt.
    """
    from rich.console import Console
    from rich.progress import Progress as Bar

    gc.freeze()  # what is loaded stays: the garbage collector need not scan it
    console, scans, odometry = Console(stderr=True), inputs.scans, inputs.odometry
    with interruptible() as interruption, Bar(console=console, disable=not console.is_terminal, transient=True) as bar:
        task = bar.add_task("scans", total=len(scans))
        waiting = perf_counter()
        try:
            for scan in scans:
                if scan.index <= progress.index and not interruption:
                    continue
                progress.seconds["reading"] += perf_counter() - waiting
                if interruption:
                    checkpoints.write(slam, asdict(progress))
                    return f"interrupted after {progress.fed} of {len(scans)} scans"
                _add_imu(slam, inputs.imu, scan.stamp_ns)
                T_odom_sensor = scan.T_odom_sensor if odometry is None else odometry.at(scan.stamp_ns)
                step = scan.step_covariance if odometry is None else None
                update = slam.add_scan(scan.stamp_ns, scan.points, scan.point_times, T_odom_sensor, step)
                for watcher in on_scan:
                    assert isinstance(slam, SceneGraphSlam)
                    watcher(slam, update, scan.points)
                progress.index, progress.fed = scan.index, progress.fed + 1
                bar.update(task, completed=scan.index + 1)
                began = perf_counter()
                checkpoints.write_if_due(slam, asdict(progress))
                waiting = perf_counter()
                progress.seconds["checkpoints"] += waiting - began
        except UserError as error:
            if not progress.fed:
                raise
            return str(error)
    checkpoints.write(slam, asdict(progress))  # who is interrupted while the map is completed loses no scan
    return None


def _add_imu(slam: TakesScans, imu: ImuSamples | None, stamp_ns: int) -> None:
    """Adds the samples until the end of a scan that were not added yet."""
    if imu is None:
        return
    newest = slam.newest_imu_ns
    first = 0 if newest is None else int(np.searchsorted(imu.stamps_ns, newest, side="right"))
    last = int(np.searchsorted(imu.stamps_ns, stamp_ns + _SCAN_NS, side="right"))
    if last > first:
        slam.add_imu(imu.stamps_ns[first:last], imu.gyro[first:last], imu.accel[first:last])
