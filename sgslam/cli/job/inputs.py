"""The inputs of a run, opened from the files that its options name, and checked."""

import hashlib
import json
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from data.common.errors import EndOfScansError, UserError
from data.control import ControlPoint, read_control
from data.imu import ImuSamples, read_imu
from data.plans import Bim, load_bim
from data.scans import Scan, ScanSource
from data.scans.evalio import is_evalio
from data.scans.sources import open_scans
from data.scene_graph import Floor, SceneGraph
from data.trajectory import Trajectory
from sgslam.anchoring import check_storey
from sgslam.cli.options import RunOptions, Triple
from sgslam.config import Config
from sgslam.config.loading import load_config
from sgslam.config.sensor import SENSOR
from sgslam.geometry.trajectory_errors import associate
from sgslam.odometry.factory import ExternalOdometry, choose
from sgslam.perception.scan_checks import in_metres_and_sensor_frame
from sgslam.result.saving import prepare_folder
from sgslam.session import PriorMap
from sgslam.session.checkpoints import read_run
from sgslam.warm_up import compile_ahead

_OPTIONS = TypeAdapter(RunOptions)
_BESIDE_RESUME = {"resume", "view", "rerun", "strict", "verbose"}  # all else is as it was
_NOT_READ = {"out", "resume", "rerun", "config"}  # paths that a run that is resumed does not read


class MatcherWithStart:
    """A matcher with a rough initial pose of the map, `start`: x, y, yaw, in the order of `--start`; None: unknown."""

    def __init__(self, matcher: Any, start: Triple | None) -> None:
        self._matcher, self.start = matcher, start

    def match(self, s: SceneGraph, a: SceneGraph) -> Any:
        if self.start is None:
            return self._matcher.match(s, a)
        x, y, yaw = self.start
        return self._matcher.match(s, a, start=(yaw, x, y))


class PassedScans(ScanSource):
    """Stands for the scans of a source that another process reads; `path` is that of the source."""

    def __init__(self, path: Path, count: int = 0) -> None:
        super().__init__()
        self.path, self._count = path, count

    def __len__(self) -> int:
        return self._count

    def _read(self, index: int) -> Scan:
        raise EndOfScansError


@dataclass(frozen=True, eq=False)
class Building:
    """What a run is compared with: the plan, the map of an earlier run and the true poses, None without one, and the
    matcher. `began` and `cpu_began` are the readings of the wall clock and of the CPU clock (s) at the start of the
    run, `seconds` is the time that reading the plan took. `control` are surveyed points."""

    bim: Bim | None
    prior_map: PriorMap | None
    truth: Trajectory | None
    matcher: MatcherWithStart
    began: float
    cpu_began: float
    seconds: float
    control: tuple[ControlPoint, ...] = ()


@dataclass(frozen=True, eq=False)
class RunInputs:
    """What a run needs of its files. `options` name the folder for the results too.

    `odometry`, of a file, and `imu` are None without one, and where another process tracks. `resumed` is what the state
    of the run to be resumed says about it, None of a new one.
    """

    options: RunOptions
    config: Config
    scans: ScanSource
    odometry: ExternalOdometry | None = None
    imu: ImuSamples | None = None
    resumed: dict[str, Any] | None = None

    @staticmethod
    def read(options: RunOptions) -> "RunInputs":
        """Opens all that tracking needs; what the options lack is taken from the run to be resumed, or made for the
        demo. Raises UserError."""
        resumed = None
        if options.resume is not None:
            options, resumed = _resumed(options, options.resume)
        config, odometry = read_settings(options, resumed and resumed["config"])
        options = replace(options, out=options.out or default_out())
        if options.demo:
            options = _demo(options)
        scans = _open_scans(options, config)
        if config.tracking.stamp == "auto":
            config = _with(config, "tracking", stamp=scans.stamped)
        next(in_metres_and_sensor_frame(scans), None)  # wrong ones are refused before the output folder is touched
        if not scans.is_dense:  # too far apart to be registered
            config = _with(config, "odometry", given="exact")
        imu = None if options.imu is None else read_imu(options.imu, options.imu_topic)
        if odometry is not None and scans.stamps_ns is not None:
            odometry.check(scans.stamps_ns)
        return RunInputs(options, config, scans, odometry, imu, resumed)

    @property
    def out(self) -> Path:
        """The folder for the results."""
        assert self.options.out is not None
        return self.options.out

    def passed(self) -> "RunInputs":
        """What a process is told that does not read the scans."""
        scans = PassedScans(self.scans.path, len(self.scans))
        for name in ("note", "stamps_ns", "given", "stamped", "is_dense"):
            setattr(scans, name, getattr(self.scans, name))
        return replace(self, scans=scans, odometry=None, imu=None)

    def read_building(self) -> Building:
        """Opens what the map is built and compared with; a plan that is missing is that of the prior map. Raises
        UserError."""
        from matching import Matcher  # slow to load

        options, config, scans = self.options, self.config, self.scans
        try:
            matcher = Matcher.load(config.matching.method)
        except UserError as error:
            raise UserError(f"setting matching.method: {error}") from None
        prior = None if options.map is None else self._prior_map(options.map)
        plan = options.bim
        if plan is None and (options.storey is not None or options.start is not None or options.control is not None):
            raise UserError("--storey, --start and --control refer to a building; give --bim too")
        if plan is None and prior is not None and prior.T_bim_map is not None and options.map is not None:
            anchored_to = options.map / "a_graph.json"
            plan = anchored_to if anchored_to.is_file() else None
        truth = None if options.ground_truth is None else Trajectory.read_tum(options.ground_truth)
        stamps = scans.stamps_ns  # None for a bag, whose stamps are known only after reading it
        if truth is not None and stamps is not None and not len(associate(stamps, truth.stamps_ns)[0]):
            raise UserError(
                f"{options.ground_truth}: no stamp is close to a scan's; the truth must use the scans' clock"
            )
        began, cpu_began = perf_counter(), process_time()
        bim = None if plan is None else load_bim(plan, layers=options.layer)
        seconds, cpu_seconds = perf_counter() - began, process_time() - cpu_began
        if bim is not None:
            check_storey(bim.graph, options.storey)
        control = self._control(bim)
        if not isinstance(scans, PassedScans):  # else the process that passes them has compiled
            compile_ahead().wait()  # not counted in the run's time
        began, cpu_began = perf_counter() - seconds, process_time() - cpu_seconds
        with_start = MatcherWithStart(matcher, options.start)
        return Building(bim, prior, truth, with_start, began, cpu_began, seconds, control)

    def _control(self, bim: Bim | None) -> tuple[ControlPoint, ...]:
        """The control points, each with a scan near its time as far as the stamps are known."""
        path, stamps = self.options.control, self.scans.stamps_ns
        if path is None or bim is None:
            return ()
        points = read_control(path, bim.graph.georeference)
        for point in points:
            if stamps is not None and np.abs(stamps - point.stamp_ns).min() > 1e9 * SENSOR.longest_scan:
                raise UserError(f"{path}: no scan is near the time of point {point.name}; give it by the scans' clock")
        return points

    def header(self) -> dict[str, Any]:
        """What a state says about its run, in JSON form: a digest of the files that it reads, its settings and its
        options. Raises UserError if the files are not those of the run to be resumed."""
        read = [own for name, own in vars(self.options).items() if isinstance(own, Path) and name not in _NOT_READ]
        folders = [sorted(path.iterdir()) if path.is_dir() else [path] for path in read]
        files = [own for folder in folders for own in folder if own.is_file()]
        stats = [(own.name, own.stat().st_size, own.stat().st_mtime_ns) for own in files]
        digest = hashlib.sha256(json.dumps(stats).encode()).hexdigest()
        if self.resumed is not None and self.resumed["files"] != digest:
            changed = "a file that the run reads has changed since it began"
            raise UserError(f"--resume {self.out}: {changed}; start a new run")
        told = _lasting(replace(self.options, resume=None, view=None, rerun=None))
        arguments = _OPTIONS.dump_python(told, mode="json")
        return {"files": digest, "config": self.config.model_dump(mode="json"), "arguments": arguments}

    def _prior_map(self, folder: Path) -> PriorMap:
        if self.out.resolve() == folder.resolve():
            raise UserError(f"--map {folder}: is also the --out folder; give another --out")
        return PriorMap.load(folder, self.config)


def default_out() -> Path:
    """The folder for the results of a run that begins now."""
    return Path("out") / datetime.now().strftime("%Y-%m-%d_%H-%M-%S")


def read_settings(options: RunOptions, before: dict[str, Any] | None = None) -> tuple[Config, ExternalOdometry | None]:
    """The settings that the options give, on those `before` of the run to be resumed, and the odometry of a file if
    there is one. Raises UserError."""
    config = load_config(options.config, list(options.set)) if before is None else Config.model_validate(before)
    config, odometry = (config, None) if options.odometry is None else choose(options.odometry, config)
    for group, name in (("tracking", "mount"), ("tracking", "stamp"), ("as_built", "tolerance")):
        if (value := getattr(options, name)) is not None:
            config = _with(config, group, **{name: value})
    return config, odometry


def _with(config: Config, group: str, **settings: Any) -> Config:
    return config.model_copy(update={group: getattr(config, group).model_copy(update=settings)})


def _resumed(options: RunOptions, folder: Path) -> tuple[RunOptions, dict[str, Any]]:
    """The options of the run in the folder, with those that are given now too, and what its state says about it.

    Raises UserError if there is no such run, if it is finished, and for options that do not go with `--resume`.
    """
    now = options.changed()
    if other := [f"--{name.replace('_', '-')}" for name in now if name not in _BESIDE_RESUME]:
        raise UserError(f"--resume {folder}: inputs and settings are those of that run; leave out {', '.join(other)}")
    about, _ = read_run(folder)
    if about.get("finished"):
        raise UserError(f"--resume {folder}: that run is finished; its results are in the folder")
    before = _OPTIONS.validate_python(about["arguments"])
    if before.live:
        raise UserError(f"--resume {folder}: that run was live, and cannot continue; start a new one")
    return replace(before, **now, out=folder), about


def _lasting(options: RunOptions) -> RunOptions:
    """With paths that hold in any folder; a data set's sequence is no path."""
    lasting: dict[str, Any] = {
        name: own.resolve() for name, own in vars(options).items() if isinstance(own, Path) and not is_evalio(own)
    }
    if options.odometry is not None and Path(options.odometry).is_file():
        lasting["odometry"] = str(Path(options.odometry).resolve())
    return replace(options, **lasting)


def _open_scans(options: RunOptions, config: Config) -> ScanSource:
    if options.slam_output is not None:
        from data.slam_output import open_slam_output

        more = (options.cloud, options.times, config.tracking.stamp)
        return open_slam_output(options.slam_output, options.scan_dir, options.topic, *more)
    assert options.scan_dir is not None
    return open_scans(options.scan_dir, options.topic, config.tracking.stamp)


def _demo(options: RunOptions) -> RunOptions:
    """Writes a building and a simulated drive through it to the output folder; returns the options of a run on them.

    Raises UserError for an unknown storey, for other scans, and if the folder contains a demo already.
    """
    from data.generation import DEMO_STOREYS, write_demo_building
    from data.simulation.simulate import simulate

    if options.scan_dir is not None or options.bim is not None:
        raise UserError("--demo brings its own scans and building; leave out --scan-dir and --bim")
    assert options.out is not None
    out = prepare_folder(options.out)
    bim, drive = out / "demo_building.ifc", out / "demo_drive"
    if drive.exists():
        raise UserError(f"{out}: contains a demo already; give another --out")
    floors = tuple(Floor(name, name) for name in DEMO_STOREYS)
    check_storey(SceneGraph("bim", floors=floors), options.storey)  # before anything is written
    print(f"demo: writing a building with two storeys to {bim}")
    write_demo_building(bim)
    names = " and ".join(f"'{name}'" for name in DEMO_STOREYS)
    print(f"demo: simulating a LiDAR drive through {names} in {drive}")
    compile_ahead()  # meanwhile
    simulate(bim, DEMO_STOREYS, drive, seed=options.seed, min_rooms=4, min_length=30.0)
    print("demo: running SLAM on the scans and the building")
    return replace(options, demo=False, bim=bim, scan_dir=drive / "scans", ground_truth=drive / "truth.tum")
