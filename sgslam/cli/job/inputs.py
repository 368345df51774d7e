"""The inputs of a run, read and checked."""

import argparse
from dataclasses import dataclass
from time import perf_counter, process_time
from typing import Any

from data.common.errors import UserError
from data.imu import ImuSamples, read_imu
from data.plans import Bim, load_bim
from data.scans import ScanSource
from data.scans.point_times import Stamped
from data.scans.sources import open_scans
from data.scene_graph import SceneGraph
from data.trajectory import Trajectory
from sgslam.anchoring import check_storey
from sgslam.cli.compile_ahead import compile_ahead
from sgslam.cli.job.arguments import Start, out_folder, read_config, read_start, with_stamp
from sgslam.cli.job.resume_arguments import restore_arguments
from sgslam.config import Config
from sgslam.odometry.external import ExternalOdometry
from sgslam.perception.scan_checks import in_metres_and_sensor_frame
from sgslam.report import associate
from sgslam.session import PriorMap


class MatcherWithStart:
    """A matcher with a rough initial pose of the map, `start`: x, y, yaw, in the order of `--start`; None: unknown."""

    def __init__(self, matcher: Any, start: Start | None) -> None:
        self._matcher, self.start = matcher, start

    def match(self, s: SceneGraph, a: SceneGraph) -> Any:
        if self.start is None:
            return self._matcher.match(s, a)
        x, y, yaw = self.start
        return self._matcher.match(s, a, start=(yaw, x, y))


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
    matcher: MatcherWithStart
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
    start = None if options.start is None else read_start(options.start)
    matcher = _matcher(config.matching.method)
    if options.demo:
        _make_demo(options)
    prior = None if options.map is None else _prior_map(options, config)
    if options.bim is None and (options.storey is not None or options.start is not None):
        raise UserError("--storey and --start refer to a building; give --bim too")
    scans = _open_scans(options, config.tracking.stamp) if scans is None else scans
    if config.tracking.stamp == "auto":
        config = with_stamp(config, scans.stamped)
    next(in_metres_and_sensor_frame(scans), None)  # wrong ones are refused before the output folder is touched
    if not scans.is_dense:  # too far apart to be registered
        config = config.model_copy(update={"odometry": config.odometry.model_copy(update={"given": "exact"})})
    imu = None if options.imu is None else read_imu(options.imu, options.imu_topic)
    truth = None if options.ground_truth is None else Trajectory.read_tum(options.ground_truth)
    stamps = scans.stamps_ns  # None for a bag, whose stamps are known only after reading it
    if truth is not None and stamps is not None and not len(associate(stamps, truth.stamps_ns)[0]):
        raise UserError(f"{options.ground_truth}: no stamp is close to a scan's; the truth must use the scans' clock")
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


def _open_scans(options: argparse.Namespace, stamped: Stamped) -> ScanSource:
    if options.slam_output is None:
        return open_scans(options.scan_dir, options.topic, stamped)
    from data.slam_output import open_slam_output

    return open_slam_output(
        options.slam_output, options.scan_dir, options.topic, options.cloud, options.times, stamped
    )  # fmt: skip


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


def _matcher(method: str) -> Any:
    from matching import Matcher

    try:
        return Matcher.load(method)
    except UserError as error:
        raise UserError(f"setting matching.method: {error}") from None
