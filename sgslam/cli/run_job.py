"""What a run is told, read and checked (`read_job`); and the run that comes of it, from its folder to its results."""

import argparse
import logging
import math
import sys
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from threading import Timer
from time import perf_counter, process_time
from typing import Any

from data.common.errors import UserError
from data.ifc.bcf import Model
from data.plans.bim import Bim, load_bim
from data.scans import ScanSource
from data.scans.sources import open_scans
from data.scene_graph import SceneGraph
from data.trajectory import Trajectory
from sgslam.anchoring.storey_hypotheses import check_storey
from sgslam.as_built.findings import write_topics
from sgslam.cli.export import BCF
from sgslam.cli.resume_arguments import take_up, told_by
from sgslam.cli.run_fingerprint import check_same, inputs_of
from sgslam.cli.scan_loop import Progress
from sgslam.config import Config
from sgslam.config.loading import load_config
from sgslam.mapping.keyframe_clouds import FILE as CLOUDS
from sgslam.mapping.keyframe_clouds import KeyframeClouds
from sgslam.odometry.choice import choose
from sgslam.odometry.external import ExternalOdometry
from sgslam.report.accuracy import accuracy, associate
from sgslam.session.checkpoints import Checkpoints, load
from sgslam.session.prior_map import PriorMap
from sgslam.session.result import Result, prepare_folder, save_result
from sgslam.slam import SceneGraphSlam

_log = logging.getLogger("sgslam")
Start = tuple[float, float, float]
_SILENT = 5.0  # s that a user waits without a word


@dataclass(frozen=True, eq=False)
class Job:
    """`before` is what the run was of that goes on, `given` the odometry from outside, `earlier` the known map; each is
    None where there is none. It `began` at that time of the clock, with so many seconds of the processors `used`, and
    reading the building took `bim_seconds`."""

    options: argparse.Namespace
    before: dict[str, Any] | None
    config: Config
    given: ExternalOdometry | None
    start: Start | None
    matcher: Any
    earlier: PriorMap | None
    scans: ScanSource
    truth: Trajectory | None
    bim: Bim | None
    began: float
    used: float
    bim_seconds: float

    @property
    def a_graph(self) -> SceneGraph | None:
        """The building's, where one is given."""
        return None if self.bim is None else self.bim.graph


def read_job(options: argparse.Namespace) -> Job:
    """Reads all that the options name, and fills in what they leave to the run that goes on, the known map or the demo.
    Raises UserError."""
    before = None if options.resume is None else take_up(options)
    if before is None or options.config is not None or options.set:
        config = load_config(options.config, options.set)
    else:
        config = Config.model_validate(before["config"])
    config, given = (config, None) if options.odometry is None else choose(options.odometry, config)
    start = None if options.start is None else _start(options.start)
    matcher = _matcher(config.matching.method)
    if options.demo:
        _make_demo(options)
    earlier = None if options.map is None else _prior_map(options, config)
    if options.bim is None and (options.storey is not None or options.start is not None):
        raise UserError("--storey and --start say where in the building; give --bim too")
    scans = open_scans(options.scan_dir, options.topic)
    truth = None if options.ground_truth is None else Trajectory.read_tum(options.ground_truth)
    known = scans.stamps_ns  # a bag's are not, before it is read
    if truth is not None and known is not None and not len(associate(known, truth.stamps_ns)[0]):
        raise UserError(f"{options.ground_truth}: no stamp is near a scan's; give the truth by the scans' clock")
    if given is not None and known is not None:
        given.check(known)
    began, used = perf_counter(), process_time()
    bim = None if options.bim is None else load_bim(options.bim, layers=options.layer)
    seconds = perf_counter() - began
    if bim is not None:
        check_storey(bim.graph, options.storey)
    if bim is not None or earlier is not None:  # after all mistakes; no part of the run's time
        read, spent = perf_counter() - began, process_time() - used
        _made_ready(matcher, config.matching.method)
        began, used = perf_counter() - read, process_time() - spent
    if start is not None:
        matcher = _StartedMatcher(matcher, start)
    return Job(options, before, config, given, start, matcher, earlier, scans, truth, bim, began, used, seconds)


def _made_ready(matcher: Any, method: str) -> None:
    from matching.self_test import make_ready

    told = Timer(_SILENT, print, ["compiling, once for a version: half a minute or more"], {"file": sys.stderr})
    told.start()
    try:
        make_ready(matcher, method)
    finally:
        told.cancel()


def out_folder(options: argparse.Namespace) -> Path:
    """Where the results go, made if need be; raises UserError where it cannot be written to."""
    return prepare_folder(options.out or Path("out") / datetime.now().strftime("%Y-%m-%d_%H-%M-%S"))


class Run:
    """A job in its out folder, ready to be fed with its scans, from `progress` on."""

    def __init__(self, job: Job, out: Path) -> None:
        """Raises UserError where a run that is to go on is given other inputs than it had."""
        self._job, self._out, options, before = job, out, job.options, job.before
        self._told = {"storey": options.storey, "start": job.start}
        inputs = inputs_of(
            job.scans, job.a_graph, job.config, {**self._told, "topic": options.topic}, options.map
        )  # fmt: skip
        if before is not None:
            check_same(out, before, inputs)
        _log_to(out / "run.log", options.verbose, anew=before is None)
        for notice in [job.scans.note, *(job.bim.notices if job.bim is not None else ())]:
            if notice:
                _log.warning("%s", notice)
        voxel = job.config.clouds.keyframe_voxel
        if before is None:
            clouds = KeyframeClouds(out / CLOUDS, voxel)
        else:
            clouds = KeyframeClouds.open(out / CLOUDS, before["keyframes"], voxel)
        self.slam = SceneGraphSlam(
            job.a_graph, job.matcher, job.config, clouds=clouds, prior=job.earlier, storey=options.storey
        )  # fmt: skip
        self.progress = Progress() if before is None else Progress(**load(out, self.slam))
        self.checkpoints = Checkpoints(out, {**inputs, "arguments": told_by(options)})
        if before is None:  # what an earlier run left there is none of this one's
            self.checkpoints.write(self.slam, self.progress.to_dict())
        _log.info("%d scans in %s; building: %s", len(job.scans), job.scans.path, options.bim or "none")

    def finish(self, broken: str | None) -> dict[str, Any]:
        """Leaves the results in the folder and returns what metrics.json holds. Raises UserError where the scans were
        `broken` off early, for the reason that is told."""
        job, out = self._job, self._out
        for skipped in job.scans.skipped:
            _log.warning("%s is skipped: %s", skipped.name, skipped.reason)
        for remark in job.scans.remarks:
            _log.warning("%s", remark)
        result = self.slam.finish()
        total, cpu_seconds = perf_counter() - job.began, process_time() - job.used
        _log.info("%s: %s", "anchored" if result.anchored else "not anchored", result.reason)
        for kind, count in result.factors.counts().items():
            _log.info("factors, %s: %s", kind, ", ".join(f"{number} {what}" for what, number in count.items()))
        seconds = {**result.seconds, "bim": job.bim_seconds, **self.progress.seconds, "total": total}
        more: dict[str, Any] = {"scans_skipped": len(job.scans.skipped), "seconds": seconds}
        more["cpu_seconds"] = cpu_seconds  # of all threads together
        more["told"] = self._told
        if job.truth is not None:
            more["accuracy"] = _accuracy(result, job.truth)
        metrics = save_result(result, out, a_graph=job.a_graph, truth=job.truth, more=more)
        if job.bim is not None and result.T_bim_map is not None:
            model = Model(job.options.bim.name)
            write_topics(out / BCF, result.deviations, job.bim.graph, result.s_graph, result.T_bim_map, model)
        if broken is not None:
            how = f"; 'python -m sgslam.run --resume {out}' goes on" if broken.startswith("interrupted") else ""
            raise UserError(f"{broken}; what was computed up to there is in {out}{how}")
        self.checkpoints.write(self.slam, self.progress.to_dict(), finished=True)
        return metrics


def _prior_map(options: argparse.Namespace, config: Config) -> PriorMap:
    if options.out is not None and options.out.resolve() == options.map.resolve():
        raise UserError(f"--map {options.map}: is the --out folder too; give another --out")
    earlier = PriorMap.load(options.map, config)
    plan = options.map / "a_graph.json"
    if options.bim is None and earlier.T_bim_map is not None and plan.is_file():
        options.bim = plan  # the building that the map is anchored to
    return earlier


def _make_demo(options: argparse.Namespace) -> None:
    from sgslam.cli.run_demo import make_demo  # the simulator's libraries, for the demo alone

    if options.scan_dir is not None or options.bim is not None:
        raise UserError("--demo brings its own scans and building; leave --scan-dir and --bim out")
    make_demo(options, out_folder(options))


def _start(text: str) -> tuple[float, float, float]:
    try:
        x, y, yaw = (float(part) for part in text.split(","))
    except ValueError:
        raise UserError(f"--start {text}: not of the form X,Y,YAW, such as 3.5,-1.2,1.57") from None
    if not all(math.isfinite(value) for value in (x, y, yaw)):
        raise UserError(f"--start {text}: not finite numbers")
    return x, y, yaw


def _matcher(method: str) -> Any:
    from matching import Matcher

    try:
        return Matcher.load(method)
    except UserError as error:
        raise UserError(f"setting matching.method: {error}") from None


class _StartedMatcher:
    """A matcher that is told roughly where the map begins."""

    def __init__(self, matcher: Any, start: tuple[float, float, float]) -> None:
        self._matcher, self._start = matcher, start

    def match(self, s: SceneGraph, a: SceneGraph) -> Any:
        return self._matcher.match(s, a, start=self._start)


def _accuracy(result: Result, truth: Trajectory) -> dict[str, Any]:
    return accuracy(result.trajectory if result.anchored else None, result.trajectory_odometry, truth)


def _log_to(path: Path, verbose: bool, anew: bool) -> None:
    logging.raiseExceptions = False  # where the disk is full, the run goes on without its log
    _log.setLevel(logging.DEBUG if verbose else logging.INFO)
    screen = logging.StreamHandler(sys.stderr)
    screen.setLevel(logging.DEBUG if verbose else logging.WARNING)
    screen.setFormatter(logging.Formatter("%(message)s"))
    file = logging.FileHandler(path, mode="w" if anew else "a")
    file.setFormatter(logging.Formatter("%(asctime)s %(levelname)s %(name)s: %(message)s"))
    _log.handlers = [screen, file]
