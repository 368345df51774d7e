"""The side of the process that tracks: scans in, tracked ones to the process that maps.

The results are those of one process, bit by bit.
"""

import logging
import sys
from contextlib import suppress
from functools import partial
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from data.common.errors import UserError
from sgslam.cli.job.inputs import RunInputs
from sgslam.cli.job.run import Progress, interrupted, run_scans
from sgslam.cli.options import RunOptions
from sgslam.cli.processes.mapping_process import MappingProcess
from sgslam.config import Config
from sgslam.serialization import pack, unpack
from sgslam.session.checkpoints import load
from sgslam.tracking import RunTracker
from sgslam.types import TrackedScan
from sgslam.warm_up import compile_ahead

Floats = NDArray[np.float64]


class LogLines(logging.Handler):
    """Sends log lines to the process that keeps the log of the run."""

    def __init__(self, mapping: MappingProcess) -> None:
        super().__init__(logging.INFO)
        self._mapping = mapping

    def emit(self, record: logging.LogRecord) -> None:
        with suppress(UserError):  # the other process has ended
            self._mapping.put("log", name=record.name, level=record.levelno, text=record.getMessage())


class TrackingSide:
    """Tracks scans, and hands each over to a `mapping` process that is ready."""

    def __init__(self, config: Config, mapping: MappingProcess) -> None:
        self.tracking, self.mapping, self._config = RunTracker(config), mapping, config
        self._seconds, self._cpu_began = 0.0, process_time()
        self._lines = LogLines(mapping)
        logging.getLogger("sgslam").addHandler(self._lines)

    def add_scan(
        self,
        stamp_ns: int,
        points: NDArray[np.floating[Any]],
        point_times: Floats | None = None,
        T_odom_sensor: Floats | None = None,
        step_covariance: Floats | None = None,
    ) -> list[TrackedScan]:
        """See `RunTracker.track`. Raises UserError also where the map cannot go on."""
        began = perf_counter()
        scans = self.tracking.track(stamp_ns, points, point_times, T_odom_sensor, step_covariance)
        self._seconds += perf_counter() - began
        self._hand_over(scans)
        if (failed := self.mapping.state.failed) is not None:
            raise UserError(failed)
        return scans

    def add_imu(self, stamp_ns: int | NDArray[np.int64], gyro: Floats, accel: Floats) -> None:
        """See `SceneGraphSlam.add_imu`."""
        self.tracking.motion.add_imu(stamp_ns, gyro, accel)

    def save(self, progress: Progress) -> None:
        """Has the process that maps write a checkpoint, with the state of the tracker."""
        self.mapping.put("save", tracking=pack(self.tracking, self._config), progress=vars(progress))

    def restore(self, state: dict[str, bytes]) -> None:
        """Restores the tracker's part of a run's state."""
        self.tracking = unpack(state["tracking"], self._config)

    def finish(self, **told: Any) -> dict[str, Any]:
        """Hands over all scans that wait, and what is `told` (see `RunMap.finish`); returns the content of metrics.json
        once the results are written. Raises UserError."""
        began = perf_counter()
        scans = self.tracking.release()
        self._seconds += perf_counter() - began
        try:
            self._hand_over(scans)
        finally:
            logging.getLogger("sgslam").removeHandler(self._lines)
        return self.mapping.finish(seconds=self._seconds, cpu_seconds=process_time() - self._cpu_began, **told)

    def _hand_over(self, scans: list[TrackedScan]) -> None:
        for scan in scans:
            self.mapping.put("add", scan=scan, notes=self.tracking.notes)


def settle_threads() -> None:
    """Before a run: threads of this process are not to wait for each other."""
    threadpool_limits(1, user_api="blas")  # a scan is small: more threads would only wait for each other
    sys.setswitchinterval(1e-4)  # with the default interval the reading thread slows the run down


def run_in_two_processes(options: RunOptions, mapping: MappingProcess) -> tuple[dict[str, Any], Path]:
    """Reads and tracks the scans here, while the `mapping` process builds the map; returns the content of metrics.json
    and the folder.

    Raises UserError, and KeyboardInterrupt at the second interrupt.
    """
    try:
        inputs = RunInputs.read(options)
        compile_ahead().wait()
        mapping.begin(inputs.passed())
        mapping.wait_until_ready()
        logging.getLogger("sgslam").setLevel(logging.INFO)  # that process decides what is printed
        side = TrackingSide(inputs.config, mapping)
        progress = Progress() if inputs.resumed is None else Progress(**load(inputs.out, side.restore)["progress"])
        stopped = run_scans(side, inputs, progress, partial(side.save, progress))
    except BaseException:
        mapping.kill()
        raise
    try:
        told = {"skipped": inputs.scans.skipped, "remarks": inputs.scans.remarks, "progress": vars(progress)}
        return side.finish(stopped=stopped, **told), inputs.out
    except KeyboardInterrupt:
        mapping.kill()
        if stopped is not None:
            raise
        raise interrupted(inputs.out) from None
