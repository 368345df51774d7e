"""A run in its output folder: the loop over its scans, which stops cleanly when interrupted, and the results."""

import gc
import logging
import signal
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from time import perf_counter, process_time
from types import FrameType
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from data.common.bars import bars
from data.common.cli import log_to
from data.common.errors import UserError
from data.trajectory import Trajectory
from sgslam.cli.job.inputs import Building, RunInputs
from sgslam.geometry.trajectory_errors import accuracy
from sgslam.mapping import KeyframeClouds
from sgslam.mapping.keyframe_clouds import FILE as CLOUDS
from sgslam.report.tables import badge
from sgslam.result import Result
from sgslam.result.saving import save_result
from sgslam.session.checkpoints import EVERY_S, load, write_run
from sgslam.session.checkpoints import FILE as STATE
from sgslam.session.scan_points import FILE as POINTS
from sgslam.slam import SceneGraphSlam
from sgslam.types import Update

if TYPE_CHECKING:
    from sgslam.cli.processes.tracking_side import TrackingSide

Floats = NDArray[np.float64]
ScanCallback: TypeAlias = Callable[[SceneGraphSlam, Update, Floats], None]
_SCAN_NS = 200_000_000  # as long as a scan lasts at most, from its stamp on
_log = logging.getLogger("sgslam")
_FAR = 10.0  # standard deviations: a truth that is so far off even after alignment is hardly of this drive
_NOT_JUDGED = (
    "odometry {} does not judge scans: they are good, or lost after an impossible step; their sigmas come from the "
    "settings odometry.other_sigma_rotation and other_sigma_translation; health and quality of this run say little"
)


@dataclass
class Progress:
    """The progress of a run: `index` of the newest scan, the numbers of scans `fed` to it and of `imu` samples, the
    `seconds` spent on reading scans and writing checkpoints, and the `warnings` that it printed."""

    index: int = -1
    fed: int = 0
    imu: int = 0
    seconds: dict[str, float] = field(default_factory=lambda: {"reading": 0.0, "checkpoints": 0.0})
    warnings: list[str] = field(default_factory=list)


class Run:
    """A run in its output folder: the SLAM system, and its progress."""

    def __init__(self, inputs: RunInputs, building: Building, tracks: bool = True) -> None:
        """`tracks`: not where another process does. Raises UserError if the inputs differ from those of the run to be
        resumed."""
        self._inputs, self._building = inputs, building
        out, options, config, resumed = inputs.out, inputs.options, inputs.config, inputs.resumed
        self._header = inputs.header()
        self._warnings = log_to(_log, out / "run.log", verbose=options.verbose, append=resumed is not None)
        if resumed is None and (out / STATE).is_file():
            _log.warning("%s holds the results of an earlier run, which are overwritten", out)
        is_judged = config.odometry.method == "continuous_time" or config.odometry.given == "measured"
        note = None if is_judged else _NOT_JUDGED.format(config.odometry.method)
        for notice in [inputs.scans.note, note, *(building.bim.notices if building.bim is not None else ())]:
            if notice:
                _log.warning("%s", notice)
        voxel = config.clouds.keyframe_voxel
        if resumed is None:
            clouds = KeyframeClouds(out / CLOUDS, voxel)
        else:
            clouds = KeyframeClouds.open(out / CLOUDS, resumed["keyframes"], voxel)
        more: dict[str, Any] = {"clouds": clouds, "prior": building.prior_map, "storey": options.storey}
        more["control"] = building.control
        self.slam = SceneGraphSlam(building.bim, building.matcher, config, **more)
        self.progress = Progress()
        if resumed is not None:
            about = load(out, lambda state: self.slam.restore(state if tracks else {"map": state["map"]}))
            self.progress = Progress(**about["progress"])
        self._warnings[:0] = self.progress.warnings  # those before the interruption come first
        self.progress.warnings = self._warnings
        if resumed is None:  # replaces the state that an earlier run left in the folder
            self.save()
        plan = building.bim.path if building.bim is not None else "none"
        _log.info("%d scans in %s; building: %s", len(inputs.scans), inputs.scans.path, plan)

    def take_progress(self, progress: Mapping[str, Any]) -> None:
        """Takes the progress of the process that tracks; the warnings come here anyway."""
        self.progress = Progress(**{**progress, "warnings": self._warnings})

    def save(self, tracking: bytes | None = None, finished: bool = False) -> None:
        """Writes the state of the run; `tracking` is that of a tracker elsewhere."""
        state, progress = self.slam.state(), vars(self.progress)
        about = {**self._header, "finished": finished, "keyframes": self.slam.keyframes, "progress": progress}
        write_run(self._inputs.out, about, state if tracking is None else {**state, "tracking": tracking})

    def finish(
        self, stopped: str | None, measured: dict[str, Any] | None = None, cpu_elsewhere: float = 0.0
    ) -> dict[str, Any]:
        """Writes the results to the folder; returns the content of metrics.json, to which `measured` is added, and the
        CPU seconds of the process that tracked. Raises UserError, after writing, if the run stopped early, for the
        reason `stopped`."""
        scans, out, options = self._inputs.scans, self._inputs.out, self._inputs.options
        for skipped in scans.skipped:
            _log.warning("%s: skipped, %s", skipped.name, skipped.reason)
        for remark in scans.remarks:
            _log.warning("%s", remark)
        with bars():
            result = self._result(is_last=stopped is not None or options.single_pass or not scans.is_dense)
            numbers = self._numbers(result, stopped, cpu_elsewhere)
            metrics = save_result(result, out, truth=self._building.truth, more={**numbers, **(measured or {})})
        _log.info("%s: %s", badge(metrics), result.reason)
        if stopped is not None:
            hint = f"; {_hint(out)}" if stopped.startswith("interrupted") else ""
            raise UserError(f"{stopped}; the results so far are in {out}{hint}")
        self.save(finished=True)
        (out / POINTS).unlink(missing_ok=True)
        return metrics

    def _result(self, is_last: bool) -> Result:
        """The result, after a second pass unless the first one `is_last`."""
        try:
            result = self.slam.finish(second_pass=not is_last)
        except KeyboardInterrupt:
            if is_last:
                raise
            raise interrupted(self._inputs.out) from None
        if not is_last and result.trajectory_live is None:
            _log.info("no second pass: runs in several parts, with --map or with --imu have none")
        return replace(result, given=self._inputs.scans.given)

    def _numbers(self, result: Result, stopped: str | None, cpu_elsewhere: float) -> dict[str, Any]:
        """What metrics.json has beyond the result's own: times, what the user stated, warnings, errors, the header."""
        inputs, building = self._inputs, self._building
        total, cpu_seconds = perf_counter() - building.began, process_time() - building.cpu_began
        options = inputs.options
        told = {"storey": options.storey, "start": options.start, "mount": inputs.config.tracking.mount}
        numbers: dict[str, Any] = {
            "scans_skipped": len(inputs.scans.skipped),
            "seconds": {**result.seconds, "bim": building.seconds, **self.progress.seconds, "total": total},
            "cpu_seconds": cpu_seconds + cpu_elsewhere,  # of all threads
            "told": told,
            "advice": list(dict.fromkeys([*self._warnings, *result.advice, *([stopped] if stopped else [])])),
            "about": self._about(result),
        }
        if building.truth is not None:
            numbers["accuracy"] = _accuracy(result, building.truth, in_one_part=not self.slam.kidnaps)
        return numbers

    def _about(self, result: Result) -> dict[str, str]:
        """What the report's head says of the run, in its order."""
        bim, config = self._building.bim, result.config
        first = int(result.trajectory_map.stamps_ns[0]) if len(result.trajectory_map) else 0
        measured = datetime.fromtimestamp(first / 1e9, UTC)
        about = {
            "Building": bim.path.name if bim is not None and bim.path is not None else "",
            "Scans": self._inputs.scans.path.name,
            # otherwise the clock of the scans counts from another instant
            "Measured": measured.strftime("%Y-%m-%d %H:%M UTC") if measured.year >= 2000 else "",
            "Tolerance": f"{1000 * config.as_built.tolerance:g} mm" if result.anchored else "",
            "Stamps": f"{config.tracking.stamp} of a scan",
            "Odometry": config.odometry.method,
            "Version": f"sgslam {version('sgslam')}",
        }
        return {name: text for name, text in about.items() if text}


def interrupted(out: Path) -> UserError:
    """What is said where the user interrupts a run after its last scan."""
    return UserError(f"interrupted after the last scan; {_hint(out)}")


def _hint(out: Path) -> str:
    return f"'python -m sgslam.run --resume {out}' continues"


def _accuracy(result: Result, truth: Trajectory, in_one_part: bool) -> dict[str, Any]:
    told = result.uncertainty
    in_one_frame = result.trajectory_map.only(told.known)  # other parts were not joined to the map
    in_bim = result.trajectory if result.anchored else None
    errors = accuracy(in_bim, in_one_frame, result.trajectory_odometry if in_one_part else None, truth)
    aligned, sigma = errors["rmse_map_aligned_m"], result.quality.get("position_sigma_m")
    if aligned is not None and sigma is not None and aligned > _FAR * sigma.value:
        off = (
            f"aligned to the truth, the trajectory is off by {aligned:.2f} m, far more than its standard deviations of"
        )
        errors.setdefault("note", f"{off} {sigma.value:.3f} m say: does the truth belong to this drive?")
    return errors


class Interruption:
    """A context that defers SIGINT and SIGTERM, so that no scan is left half processed; true once the user (Ctrl-C) or
    the system has requested the process to end. The second request raises KeyboardInterrupt."""

    def __init__(self) -> None:
        self._requested = False
        self._before: dict[int, Any] = {}

    def __enter__(self) -> "Interruption":
        if threading.current_thread() is threading.main_thread():  # others have no handlers
            self._before = {own: signal.signal(own, self._request) for own in (signal.SIGINT, signal.SIGTERM)}
        return self

    def __exit__(self, *error: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def __bool__(self) -> bool:
        """Whether the end was requested."""
        return self._requested

    def _request(self, number: int, frame: FrameType | None) -> None:
        if self._requested:
            raise KeyboardInterrupt
        self._requested = True


def run_scans(
    slam: "SceneGraphSlam | TrackingSide",
    inputs: RunInputs,
    progress: Progress,
    save: Callable[[], None],
    on_scan: Sequence[ScanCallback] = (),
) -> str | None:
    """Adds the scans after `progress.index` and updates `progress`; returns the reason if it stops early, else None.

    `save` writes the run's state. `on_scan` are called after each scan, where this process builds the map. Raises
    UserError if not even one scan could be added, and KeyboardInterrupt at the second interrupt.
    """
    gc.freeze()  # what is loaded stays: the garbage collector need not scan it
    scans, odometry = inputs.scans, inputs.odometry
    with Interruption() as interruption, bars() as bar:
        task = bar.add_task("scans", total=len(scans))
        waiting = saved = perf_counter()
        try:
            for scan in scans:
                if scan.index <= progress.index and not interruption:
                    continue
                progress.seconds["reading"] += perf_counter() - waiting
                if interruption:
                    save()
                    return f"interrupted after {progress.fed} of {len(scans)} scans"
                if (imu := inputs.imu) is not None:  # the samples until the scan's end
                    new = slice(progress.imu, int(np.searchsorted(imu.stamps_ns, scan.stamp_ns + _SCAN_NS, "right")))
                    slam.add_imu(imu.stamps_ns[new], imu.gyro[new], imu.accel[new])
                    progress.imu = max(new.stop, progress.imu)
                T_odom_sensor = scan.T_odom_sensor if odometry is None else odometry.at(scan.stamp_ns)
                step = scan.step_covariance if odometry is None else None
                update: Any = slam.add_scan(scan.stamp_ns, scan.points, scan.point_times, T_odom_sensor, step)
                for watcher in on_scan:
                    assert isinstance(slam, SceneGraphSlam)
                    watcher(slam, update, scan.points)
                progress.index, progress.fed = scan.index, progress.fed + 1
                bar.update(task, completed=scan.index + 1)
                began = perf_counter()
                if began - saved >= EVERY_S:
                    save()
                    saved = perf_counter()
                waiting = perf_counter()
                progress.seconds["checkpoints"] += waiting - began
        except UserError as error:
            if not progress.fed:
                raise
            return str(error)
    save()  # who is interrupted while the map is completed loses no scan
    return None
