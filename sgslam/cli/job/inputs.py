"""The inputs of a run, read and checked."""

import argparse
from dataclasses import dataclass
from time import perf_counter, process_time
from typing import Any

from data.common.errors import UserError
from data.plans import Bim, load_bim
from data.scans import ScanSource
from data.scene_graph import SceneGraph
from data.trajectory import Trajectory
from sgslam.anchoring import check_storey
from sgslam.cli.job.arguments import Start, read_start
from sgslam.cli.job.scan_inputs import ScanInputs
from sgslam.config import Config
from sgslam.report import associate
from sgslam.session import PriorMap
from sgslam.warm_up import compile_ahead


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

    `prior_map` is None if there is none. `began` and `cpu_began` are the readings of the wall clock and of the CPU
    clock (s) at the start; `bim_seconds` is the time that reading the building took.
    """

    options: argparse.Namespace
    scan_inputs: ScanInputs
    start: Start | None
    matcher: MatcherWithStart
    prior_map: PriorMap | None
    truth: Trajectory | None
    bim: Bim | None
    began: float
    cpu_began: float
    bim_seconds: float

    @property
    def config(self) -> Config:
        """The settings."""
        return self.scan_inputs.config

    @property
    def scans(self) -> ScanSource:
        """The scans, or what stands for them."""
        return self.scan_inputs.scans

    @property
    def a_graph(self) -> SceneGraph | None:
        """The building's A-graph; None without a building."""
        return None if self.bim is None else self.bim.graph


def read_job(options: argparse.Namespace, scan_inputs: ScanInputs) -> Job:
    """Reads all other inputs that the options name; missing ones are taken from the prior map. Raises UserError."""
    config, scans = scan_inputs.config, scan_inputs.scans
    start = None if options.start is None else read_start(options.start)
    matcher = _matcher(config.matching.method)
    prior = None if options.map is None else _prior_map(options, config)
    if options.bim is None and (options.storey is not None or options.start is not None):
        raise UserError("--storey and --start refer to a building; give --bim too")
    truth = None if options.ground_truth is None else Trajectory.read_tum(options.ground_truth)
    stamps = scans.stamps_ns  # None for a bag, whose stamps are known only after reading it
    if truth is not None and stamps is not None and not len(associate(stamps, truth.stamps_ns)[0]):
        raise UserError(f"{options.ground_truth}: no stamp is close to a scan's; the truth must use the scans' clock")
    began, cpu_began = perf_counter(), process_time()
    bim = None if options.bim is None else load_bim(options.bim, layers=options.layer)
    seconds = perf_counter() - began
    if bim is not None:
        check_storey(bim.graph, options.storey)
    read, spent = perf_counter() - began, process_time() - cpu_began
    if not scan_inputs.is_passed:  # else the process that passes them has compiled
        compile_ahead().wait()  # not counted in the run's time
    began, cpu_began = perf_counter() - read, process_time() - spent
    return Job(
        options, scan_inputs, start, MatcherWithStart(matcher, start), prior, truth, bim, began, cpu_began, seconds
    )


def _prior_map(options: argparse.Namespace, config: Config) -> PriorMap:
    if options.out is not None and options.out.resolve() == options.map.resolve():
        raise UserError(f"--map {options.map}: is also the --out folder; give another --out")
    prior = PriorMap.load(options.map, config)
    plan = options.map / "a_graph.json"
    if options.bim is None and prior.T_bim_map is not None and plan.is_file():
        options.bim = plan  # the building that the map is anchored to
    return prior


def _matcher(method: str) -> Any:
    from matching import Matcher

    try:
        return Matcher.load(method)
    except UserError as error:
        raise UserError(f"setting matching.method: {error}") from None
