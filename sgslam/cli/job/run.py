"""The job of `sgslam run`: its inputs, read and checked (`read_job`), and the run in its output folder (`Run`)."""

import argparse
import logging
import math
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

from data.common.errors import UserError
from data.common.log_lines import log_to
from data.ifc.bcf import Model
from data.imu import ImuSamples, read_imu
from data.plans import Bim, load_bim
from data.scans import ScanSource
from data.scans.sources import open_scans
from data.scene_graph import SceneGraph
from data.trajectory import Trajectory
from data.trajectory.correction import moved_with
from sgslam.anchoring import check_storey
from sgslam.as_built.elements.tolerance_classes import parse_length
from sgslam.as_built.findings import remove_topics, write_topics
from sgslam.cli.compile_ahead import compile_ahead
from sgslam.cli.job.elements import verdicts_of
from sgslam.cli.job.fingerprint import check_unchanged, run_fingerprint
from sgslam.cli.job.resume_arguments import restore_arguments, run_arguments
from sgslam.cli.job.scan_loop import Progress
from sgslam.config import Config
from sgslam.config.loading import load_config
from sgslam.mapping import KeyframeClouds
from sgslam.mapping.keyframe_clouds import FILE as CLOUDS
from sgslam.odometry.choice import check_inertial, choose, health_note
from sgslam.odometry.external import ExternalOdometry
from sgslam.report import associate
from sgslam.report.accuracy import accuracy
from sgslam.session import Checkpoints, PriorMap, Result
from sgslam.session.checkpoints import FILE as STATE
from sgslam.session.checkpoints import load
from sgslam.session.result import prepare_folder, save_result
from sgslam.slam import SceneGraphSlam

_log = logging.getLogger("sgslam")
Start = tuple[float, float, float]
ALL_POSES = "trajectory_all.tum"
_TURN = 360.0  # degrees
_DATED = 946_684_800_000_000_000  # ns, 2000-01-01 in Unix time; smaller stamps are none


@dataclass(frozen=True, eq=False)
class Job:
    """The inputs of a run.

    `resumed_from` is the state header of the run to resume; it, `external_odometry` and `prior_map` are None if there
    is none. `began` and `cpu_began` are the readings of the wall clock and of the CPU clock (s) at the start;
    `bim_seconds` is the time that reading the building took.
    """

    options: argparse.Namespace
    resumed_from: dict[str, Any] | None
    config: Config
    external_odometry: ExternalOdometry | None
    start: Start | None
    matcher: "MatcherWithStart"
    prior_map: PriorMap | None
    scans: ScanSource
    truth: Trajectory | None
    bim: Bim | None
    imu: ImuSamples | None
    began: float
    cpu_began: float
    bim_seconds: float

    @property
    def a_graph(self) -> SceneGraph | None:
        """The building's A-graph; None without a building."""
        return None if self.bim is None else self.bim.graph


def read_job(options: argparse.Namespace, scans: ScanSource | None = None, config: Config | None = None) -> Job:
    """Reads all inputs that the options name; missing options are taken from the resumed run, the prior map or the
    demo. `scans` and `config`, where given, replace those that the options name. Raises UserError."""
    resumed = None if options.resume is None else restore_arguments(options)
    external = None
    if config is None:
        config, external = read_config(options, resumed)
    if options.second_pass and (config.odometry.method != "continuous_time" or options.map is not None):
        raise UserError(
            "--second-pass needs our own odometry and a run without --map: it registers all scans again; leave out "
            f"{'--map' if options.map is not None else '--odometry and odometry.method'}, or --second-pass"
        )
    start = None if options.start is None else read_start(options.start)
    matcher = _matcher(config.matching.method)
    if options.demo:
        _make_demo(options)
    prior = None if options.map is None else _prior_map(options, config)
    if options.bim is None and (options.storey is not None or options.start is not None):
        raise UserError("--storey and --start refer to a building; give --bim too")
    scans = _open_scans(options) if scans is None else scans
    imu = None if options.imu is None else read_imu(options.imu, options.imu_topic)
    if external is None and scans.given is None:
        check_inertial(config.odometry.method, imu is not None)
    truth = None if options.ground_truth is None else Trajectory.read_tum(options.ground_truth)
    stamps = scans.stamps_ns  # None for a bag, whose stamps are known only after reading it
    if truth is not None and stamps is not None and not len(associate(stamps, truth.stamps_ns)[0]):
        raise UserError(f"{options.ground_truth}: no stamp is near a scan's; the truth must use the scans' clock")
    if external is not None and stamps is not None:
        external.check(stamps)
    began, cpu_began = perf_counter(), process_time()
    bim = None if options.bim is None else load_bim(options.bim, layers=options.layer)
    seconds = perf_counter() - began
    if bim is not None:
        check_storey(bim.graph, options.storey)
    read, spent = perf_counter() - began, process_time() - cpu_began
    is_matched = bim is not None or prior is not None
    compile_ahead(matcher, config.matching.method if is_matched else None)  # not counted in the run's time
    began, cpu_began = perf_counter() - read, process_time() - spent
    return Job(
        options, resumed, config, external, start, MatcherWithStart(matcher, start), prior, scans, truth, bim, imu,
        began, cpu_began, seconds,
    )  # fmt: skip


def read_config(
    options: argparse.Namespace, resumed: dict[str, Any] | None = None
) -> tuple[Config, ExternalOdometry | None]:
    """The settings that the options give, else those of the run to be resumed, and the external odometry if there is
    one. Raises UserError."""
    if resumed is None or options.config is not None or options.set:
        config = load_config(options.config, options.set)
    else:
        config = Config.model_validate(resumed["config"])
    config, external = (config, None) if options.odometry is None else choose(options.odometry, config)
    if options.mount is not None:
        mount = three_numbers("--mount", options.mount, "ROLL,PITCH,YAW (degrees)", "0,25,0")
        config = config.model_copy(update={"tracking": config.tracking.model_copy(update={"mount": mount})})
    if options.tolerance is not None:
        as_built = config.as_built.model_copy(update={"tolerance": parse_length(options.tolerance)})
        config = config.model_copy(update={"as_built": as_built})
    return config, external


def read_start(text: str) -> Start:
    """The pose that `--start` gives. Raises UserError."""
    return three_numbers("--start", text, "X,Y,YAW", "3.5,-1.2,1.57")


def out_folder(options: argparse.Namespace) -> Path:
    """The folder for the results, created if needed. Raises UserError if it cannot be written to."""
    return prepare_folder(options.out or Path("out") / datetime.now().strftime("%Y-%m-%d_%H-%M-%S"))


class Run:
    """A job in its output folder: the SLAM system, its progress and its checkpoints."""

    def __init__(self, job: Job, out: Path) -> None:
        """Raises UserError if the inputs differ from those of the run to be resumed."""
        self._job, self._out, options, resumed = job, out, job.options, job.resumed_from
        self._hints = {"storey": options.storey, "start": job.start}
        told = {**self._hints, "topic": options.topic, "imu": None if job.imu is None else job.imu.digest()}
        inputs = run_fingerprint(job.scans, job.a_graph, job.config, told, options.map)
        if resumed is not None:
            check_unchanged(out, resumed, inputs)
        self._warnings = log_to(_log, out / "run.log", verbose=options.verbose, append=resumed is not None)
        if resumed is None and (out / STATE).is_file():
            _log.warning("%s holds the results of an earlier run, which are overwritten", out)
        note = health_note(job.config.odometry.method) if job.scans.given is job.external_odometry is None else None
        for notice in [job.scans.note, note, *(job.bim.notices if job.bim is not None else ())]:
            if notice:
                _log.warning("%s", notice)
        voxel = job.config.clouds.keyframe_voxel
        if resumed is None:
            clouds = KeyframeClouds(out / CLOUDS, voxel)
        else:
            clouds = KeyframeClouds.open(out / CLOUDS, resumed["keyframes"], voxel)
        self.slam = SceneGraphSlam(
            job.a_graph, job.matcher, job.config, clouds=clouds, prior=job.prior_map, storey=options.storey
        )  # fmt: skip
        self.progress = Progress() if resumed is None else Progress(**load(out, self.slam))
        self._warnings[:0] = self.progress.warnings  # those before the interruption come first
        self.progress.warnings = self._warnings
        self.checkpoints = Checkpoints(out, {**inputs, "arguments": run_arguments(options)})
        if resumed is None:  # replaces the state that an earlier run left in the folder
            self.checkpoints.write(self.slam, self.progress.to_dict())
        _log.info("%d scans in %s; building: %s", len(job.scans), job.scans.path, options.bim or "none")

    def finish(self, stopped: str | None, measured: dict[str, Any] | None = None) -> dict[str, Any]:
        """Writes the results to the folder; returns the content of metrics.json, to which `measured` is added. Raises
        UserError, after writing, if the run stopped early, for the reason `stopped`."""
        job, out = self._job, self._out
        for skipped in job.scans.skipped:
            _log.warning("%s: skipped, %s", skipped.name, skipped.reason)
        for remark in job.scans.remarks:
            _log.warning("%s", remark)
        skipped_scans = len(job.scans.skipped)  # a second reading counts them again
        if stopped is None and job.options.second_pass:
            self.checkpoints.write(self.slam, self.progress.to_dict())  # who is interrupted now loses no scan
        result = self.slam.finish(job.scans if stopped is None and job.options.second_pass else None)
        if job.options.second_pass and result.trajectory_live is None:
            _log.warning("there was no second pass: it needs poses of our own odometry, and a run in one part")
        total, cpu_seconds = perf_counter() - job.began, process_time() - job.cpu_began
        _log.info("%s: %s", "anchored" if result.anchored else "not anchored", result.reason)
        for kind, count in result.factors.counts().items():
            _log.info("factors, %s: %s", kind, ", ".join(f"{number} {what}" for what, number in count.items()))
        seconds = {**result.seconds, "bim": job.bim_seconds, **self.progress.seconds, "total": total}
        more: dict[str, Any] = {"scans_skipped": skipped_scans, "seconds": seconds}
        more["cpu_seconds"] = cpu_seconds  # of all threads
        more["told"] = {**self._hints, "mount": job.config.tracking.mount}
        more |= measured or {}
        more["advice"] = list(dict.fromkeys([*self._warnings, *result.advice, *([stopped] if stopped else [])]))
        if job.truth is not None:
            more["accuracy"] = _accuracy(result, job.truth)
        more["about"] = _about(job, result)
        metrics = save_result(
            result, out, a_graph=job.a_graph, truth=job.truth, more=more,
            elements=lambda: verdicts_of(result, job.options.bim, job.a_graph),
        )  # fmt: skip
        if job.bim is None or result.T_bim_map is None:
            remove_topics(out)
        else:
            model = Model(job.options.bim.name)
            write_topics(
                out, result.deviations, job.bim.graph, result.s_graph, result.T_bim_map, model,
                result.config.as_built.tolerance,
            )  # fmt: skip
        if job.scans.given is not None and len(result.trajectory):
            moved_with(job.scans.given, result.trajectory).write_tum(out / ALL_POSES)
        if stopped is not None:
            hint = f"; 'python -m sgslam.run --resume {out}' continues" if stopped.startswith("interrupted") else ""
            raise UserError(f"{stopped}; the results so far are in {out}{hint}")
        self.checkpoints.write(self.slam, self.progress.to_dict(), finished=True)
        return metrics


def _about(job: Job, result: Result) -> dict[str, str]:
    """What the report's head says of the run, in its order."""
    first = int(result.trajectory_map.stamps_ns[0]) if len(result.trajectory_map) else 0
    about = {"Building": job.options.bim.name if job.bim is not None else "", "Scans": job.scans.path.name}
    if first >= _DATED:  # else the clock of the scans counts from another instant
        about["Measured"] = datetime.fromtimestamp(first / 1e9, UTC).strftime("%Y-%m-%d %H:%M UTC")
    about["Tolerance"] = f"{1000 * result.config.as_built.tolerance:g} mm" if result.anchored else ""
    about["Odometry"] = job.config.odometry.method
    about["Version"] = f"sgslam {version('sgslam')}"
    return {name: text for name, text in about.items() if text}


def _open_scans(options: argparse.Namespace) -> ScanSource:
    if options.slam_output is None:
        return open_scans(options.scan_dir, options.topic)
    from data.slam_output import open_slam_output

    return open_slam_output(options.slam_output, options.scan_dir, options.topic, options.cloud, options.times)


def _prior_map(options: argparse.Namespace, config: Config) -> PriorMap:
    if options.out is not None and options.out.resolve() == options.map.resolve():
        raise UserError(f"--map {options.map}: is also the --out folder; give another --out")
    prior = PriorMap.load(options.map, config)
    plan = options.map / "a_graph.json"
    if options.bim is None and prior.T_bim_map is not None and plan.is_file():
        options.bim = plan  # the building that the map is anchored to
    return prior


def _make_demo(options: argparse.Namespace) -> None:
    from sgslam.cli.job.demo import make_demo  # imports the simulator, which only the demo needs

    if options.scan_dir is not None or options.bim is not None:
        raise UserError("--demo brings its own scans and building; leave out --scan-dir and --bim")
    make_demo(options, out_folder(options))


def three_numbers(option: str, text: str, form: str, example: str) -> tuple[float, float, float]:
    """The numbers of an option such as `--start X,Y,YAW`. Raises UserError."""
    try:
        a, b, c = (float(part) for part in text.split(","))
    except ValueError:
        raise UserError(f"{option} {text}: not in the form {form}; write e.g. {example}") from None
    if not all(math.isfinite(value) for value in (a, b, c)):
        raise UserError(f"{option} {text}: {form} must be finite numbers; write e.g. {example}")
    if option == "--start" and abs(c) > 2 * math.pi:
        raise UserError(f"{option} {text}: the yaw is in radians; {c:g} degrees are {math.radians(c):.4f}")
    if option == "--mount" and max(abs(a), abs(b), abs(c)) > _TURN:
        raise UserError(f"{option} {text}: give roll, pitch and yaw in degrees, each from -360 to 360")
    return a, b, c


def _matcher(method: str) -> Any:
    from matching import Matcher

    try:
        return Matcher.load(method)
    except UserError as error:
        raise UserError(f"setting matching.method: {error}") from None


class MatcherWithStart:
    """A matcher with a rough initial pose of the map, `start`: x, y, yaw, in the order of `--start`; None: unknown."""

    def __init__(self, matcher: Any, start: Start | None) -> None:
        self._matcher, self.start = matcher, start

    def match(self, s: SceneGraph, a: SceneGraph) -> Any:
        if self.start is None:
            return self._matcher.match(s, a)
        x, y, yaw = self.start
        return self._matcher.match(s, a, start=(yaw, x, y))


def _accuracy(result: Result, truth: Trajectory) -> dict[str, Any]:
    in_one_frame = result.trajectory_map.only(result.uncertainty.part == 0)  # other parts were not joined to the map
    in_bim = result.trajectory if result.anchored else None
    return accuracy(in_bim, in_one_frame, result.trajectory_odometry, truth)
