"""The options of the commands that run on a building: each is a field of `RunOptions`, with its help and checks."""

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin, get_type_hints

from data.common.errors import UserError

Triple = tuple[float, float, float]
MOST_WAITING = 600  # scans of a live run that wait for the map: a minute at 10 Hz; 20,000 points take 0.5 MB
Number = TypeVar("Number", int, float)


@dataclass(frozen=True)
class _Option:
    """How the command line gives a field of `RunOptions`: the group of the help, and arguments of `add_argument`. The
    field's type and default say the rest."""

    group: str
    help: str
    metavar: str | None = None
    read: Callable[[str], Any] | None = None
    more: tuple[tuple[str, str], ...] = ()

    def arguments(self, kind: Any, default: Any) -> dict[str, Any]:
        """Those of `ArgumentParser.add_argument`."""
        own = {"help": self.help, "metavar": self.metavar, **dict(self.more)}
        if default is False:
            return {"help": self.help, "action": "store_true"}
        if default == ():
            return {**own, "action": "append", "default": []}
        first = get_args(kind)[0] if get_args(kind) else kind
        if get_origin(first) is Literal:
            return {**own, "choices": get_args(first), "default": default}
        return {**own, "type": self.read or first, "default": default}


def _numbers(option: str, form: str, example: str) -> Callable[[str], Triple]:
    """Reads three numbers, such as those of `--start`."""

    def read(text: str) -> Triple:
        try:
            a, b, c = (float(part) for part in text.split(","))
        except ValueError:
            raise UserError(f"{option} {text}: not in the form {form}; write e.g. {example}") from None
        if not all(math.isfinite(value) for value in (a, b, c)):
            raise UserError(f"{option} {text}: {form} must be finite numbers; write e.g. {example}")
        return a, b, c

    return read


def _start(text: str) -> Triple:
    x, y, yaw = _numbers("--start", "X,Y,YAW", "3.5,-1.2,1.57")(text)
    if abs(yaw) > 2 * math.pi:
        raise UserError(f"--start {text}: the yaw is in radians; {yaw:g} degrees are {math.radians(yaw):.4f}")
    return x, y, yaw


def _mount(text: str) -> Triple:
    angles = _numbers("--mount", "ROLL,PITCH,YAW (degrees)", "0,25,0")(text)
    if max(map(abs, angles)) > 360:
        raise UserError(f"--mount {text}: give roll, pitch and yaw in degrees, each from -360 to 360")
    return angles


def _tolerance(text: str) -> float:
    from sgslam.as_built.elements.tolerance_classes import parse_length  # slow to load

    return parse_length(text)


def bounded(option: str, kind: Callable[[str], Number], least: Number, unit: str = "") -> Callable[[str], Number]:
    """Reads a number that is at least `least`. Raises UserError for a smaller one."""

    def read(text: str) -> Number:
        value = kind(text)
        if not value >= least:
            raise UserError(f"{option} {text}: give {least:g}{unit} or more")
        return value

    read.__name__ = kind.__name__  # argparse's errors name it
    return read


@dataclass(frozen=True)
class RunOptions:
    """What a run is told: by `sgslam run`, `live`, `anchor`, by a line of `batch`, and by `LiveSlam`.

    `start` is x, y (m), yaw (rad) in the BIM frame, `mount` roll, pitch, yaw in degrees, `tolerance` in metres. `live`:
    the scans come while it runs.
    """

    scan_dir: Annotated[
        Path | None,
        _Option("scans", "scans: a folder or a bag (docs/own_sensor.md); required without --demo or --resume", "DIR"),
    ] = None
    slam_output: Annotated[
        Path | None,
        _Option("scans", "poses (TUM, KITTI, EuRoC), a folder of KISS-SLAM or GLIM, or a .g2o file", "OUTPUT"),
    ] = None
    cloud: Annotated[
        Path | None, _Option("scans", "map in the poses' frame, instead of scans: .ply, .pcd, .las, ...", "FILE")
    ] = None
    times: Annotated[Path | None, _Option("scans", "stamps of the KITTI poses, in seconds, one per line", "FILE")] = (
        None
    )
    topic: Annotated[str | None, _Option("scans", "topic of the scans, if there are several", "NAME")] = None
    stamp: Annotated[
        Literal["start", "middle", "end"] | None,
        _Option("scans", "the instant of a scan that its stamp names (default: what the format fixes, else start)"),
    ] = None
    mount: Annotated[
        Triple | None,
        _Option(
            "scans",
            "roll, pitch and yaw of the sensor in degrees; needed beyond 40 (upside down: 180,0,0)",
            "R,P,Y",
            _mount,
        ),
    ] = None
    odometry: Annotated[
        str | None,
        _Option("scans", "continuous_time (default), kiss or small_gicp, or a TUM file with poses", "NAME|FILE"),
    ] = None
    imu: Annotated[Path | None, _Option("scans", "IMU samples: a bag, or CSV in the format of EuRoC", "FILE")] = None
    imu_topic: Annotated[str | None, _Option("scans", "topic of the IMU, if the bag of --imu has several", "NAME")] = (
        None
    )
    demo: Annotated[
        bool, _Option("scans", "generate a building, simulate a drive through it, and run on this drive")
    ] = False
    seed: Annotated[int, _Option("scans", "random seed of the demo drive (default: 0)", "N")] = 0
    resume: Annotated[Path | None, _Option("scans", "--out folder of an interrupted run to resume", "DIR")] = None
    bim: Annotated[
        Path | None,
        _Option("building", "the building: .ifc, .ifczip, .dxf, .geojson, or an A-graph as .json", "FILE"),
    ] = None
    layer: Annotated[tuple[str, ...], _Option("building", "wall layer of a .dxf file (repeatable)", "NAME")] = ()
    storey: Annotated[
        str | None, _Option("building", "name or id of the storey on which the run begins, if known", "NAME")
    ] = None
    start: Annotated[
        Triple | None,
        _Option(
            "building", "rough initial pose in the BIM frame (m, rad); resolves ambiguous matches", "X,Y,YAW", _start
        ),
    ] = None
    tolerance: Annotated[
        float | None,
        _Option(
            "building",
            "offset up to which an element counts as planned, e.g. 15mm (default: 30mm)",
            "LENGTH",
            _tolerance,
        ),
    ] = None
    map: Annotated[
        Path | None, _Option("building", "--out folder of an earlier run, whose map this run extends", "DIR")
    ] = None
    config: Annotated[Path | None, _Option("settings", "settings as YAML, such as a run's config.yaml", "FILE")] = None
    set: Annotated[tuple[str, ...], _Option("settings", "a single setting (repeatable)", "A.B=C")] = ()
    single_pass: Annotated[bool, _Option("settings", "do not register all scans a second time")] = False
    out: Annotated[Path | None, _Option("results", "folder for the results (default: out/<date>_<time>)", "DIR")] = None
    ground_truth: Annotated[
        Path | None,
        _Option("results", "true sensor poses in the BIM frame: TUM, with the clock of the scans", "FILE"),
    ] = None
    view: Annotated[
        str | None,
        _Option(
            "results",
            "show the run in the browser until Ctrl-C (default port: 8080)",
            "[HOST:]PORT",
            more=(("nargs", "?"), ("const", "8080")),
        ),
    ] = None
    rerun: Annotated[Path | None, _Option("results", "write a recording (.rrd) for the Rerun viewer", "FILE")] = None
    strict: Annotated[
        bool, _Option("results", "exit with code 3 unless every scan is anchored and the map is sound")
    ] = False
    verbose: Annotated[bool, _Option("results", "print log messages")] = False
    live: bool = False

    @classmethod
    def of(cls, given: argparse.Namespace) -> "RunOptions":
        """Those of a parsed command line, which may have more."""
        values: dict[str, Any] = {name: value for name, value in vars(given).items() if name in _FIELDS}
        for name in ("layer", "set"):
            values[name] = tuple(values[name])
        return cls(**values)

    def changed(self) -> dict[str, Any]:
        """The options that differ from their defaults."""
        return {name: value for name, value in vars(self).items() if value != _FIELDS[name].default}


_FIELDS = {own.name: own for own in fields(RunOptions)}
COMMON = (
    *("bim", "layer", "storey", "start", "tolerance", "map", "topic", "stamp", "mount"),
    *("config", "set", "out", "ground_truth", "verbose"),
)
ANCHORING = (*COMMON, "single_pass", "view", "rerun", "strict")  # of scans that are all there
OF_A_RUN = (*ANCHORING, "scan_dir", "odometry", "imu", "imu_topic", "demo", "seed", "resume")


def add_options(parser: argparse.ArgumentParser, *names: str, **changes: dict[str, Any]) -> None:
    """Adds the options of these names, in the groups of their help; `changes` are other arguments of some, `flag` is
    what the command line calls the option."""
    groups: dict[str, Any] = {}
    for name, hint in get_type_hints(RunOptions, include_extras=True).items():
        if name not in names and name not in changes:
            continue
        kind, option = get_args(hint)
        if option.group not in groups:
            groups[option.group] = parser.add_argument_group(option.group)
        given = {**option.arguments(kind, _FIELDS[name].default), **changes.get(name, {})}
        flag = given.pop("flag", f"--{name.replace('_', '-')}")
        groups[option.group].add_argument(flag, **given, **({"dest": name} if flag.startswith("-") else {}))
