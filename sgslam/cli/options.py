"""The options of the commands that run on a building: fields of `RunOptions`, with help and checks."""

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


def _numbers(option: str, form: str, example: str, text: str) -> Triple:
    """Reads three numbers, such as those of `--start`."""
    try:
        a, b, c = (float(part) for part in text.split(","))
    except ValueError:
        raise UserError(f"{option} {text}: not in the form {form}; write e.g. {example}") from None
    if not all(math.isfinite(value) for value in (a, b, c)):
        raise UserError(f"{option} {text}: {form} must be finite numbers; write e.g. {example}")
    return a, b, c


def _start(text: str) -> Triple:
    x, y, yaw = _numbers("--start", "X,Y,YAW", "3.5,-1.2,1.57", text)
    if abs(yaw) > 2 * math.pi:
        raise UserError(f"--start {text}: the yaw is in radians; {yaw:g} degrees are {math.radians(yaw):.4f}")
    return x, y, yaw


def _mount(text: str) -> Triple:
    angles = _numbers("--mount", "ROLL,PITCH,YAW (degrees)", "0,25,0", text)
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
        Path | None, "DIR", "scans: a folder or a bag (docs/own_sensor.md); required without --demo or --resume"
    ] = None
    slam_output: Annotated[Path | None, "OUTPUT", "poses (TUM, KITTI), a folder of KISS-SLAM, or a .g2o file"] = None
    cloud: Annotated[Path | None, "FILE", "map in the poses' frame, instead of scans: .ply, .pcd, .las, ..."] = None
    times: Annotated[Path | None, "FILE", "stamps of the KITTI poses, in seconds, one per line"] = None
    topic: Annotated[str | None, "NAME", "topic of the scans, if there are several"] = None
    stamp: Annotated[
        Literal["start", "middle", "end"] | None,
        None,
        "the instant of a scan that its stamp names (default: what the format fixes, else start)",
    ] = None
    mount: Annotated[
        Triple | None, "R,P,Y", "roll, pitch and yaw of the sensor in degrees; needed beyond 40 (upside down: 180,0,0)"
    ] = None
    odometry: Annotated[
        str | None, "NAME|FILE", "continuous_time (default), kiss or small_gicp, or a TUM file with poses"
    ] = None
    imu: Annotated[Path | None, "FILE", "IMU samples: a bag, or CSV in the format of EuRoC"] = None
    imu_topic: Annotated[str | None, "NAME", "topic of the IMU, if the bag of --imu has several"] = None
    demo: Annotated[bool, None, "generate a building, simulate a drive through it, and run on this drive"] = False
    seed: Annotated[int, "N", "random seed of the demo drive (default: 0)"] = 0
    resume: Annotated[Path | None, "DIR", "--out folder of an interrupted run to resume"] = None
    bim: Annotated[
        Path | None, "FILE", "building: .ifc, .ifczip, .dxf, .geojson, an A-graph as .json (default: map only)"
    ] = None
    layer: Annotated[tuple[str, ...], "NAME", "wall layer of a .dxf file (repeatable)"] = ()
    storey: Annotated[str | None, "NAME", "name or id of the storey on which the run begins, if known"] = None
    start: Annotated[
        Triple | None, "X,Y,YAW", "rough initial pose in the BIM frame (m, rad); resolves ambiguous matches"
    ] = None
    control: Annotated[
        Path | None, "FILE", "surveyed points that the sensor stood at or saw, as CSV (docs/own_building.md)"
    ] = None
    tolerance: Annotated[
        float | None, "LENGTH", "offset up to which an element counts as planned, e.g. 15mm (default: 30mm)"
    ] = None
    map: Annotated[Path | None, "DIR", "--out folder of an earlier run, whose map this run extends"] = None
    config: Annotated[Path | None, "FILE", "settings as YAML, such as a run's config.yaml"] = None
    set: Annotated[tuple[str, ...], "A.B=C", "a single setting (repeatable); sgslam dump-config lists all"] = ()
    single_pass: Annotated[bool, None, "do not register all scans a second time"] = False
    out: Annotated[Path | None, "DIR", "folder for the results (default: out/<date>_<time>)"] = None
    ground_truth: Annotated[
        Path | None, "FILE", "true sensor poses in the BIM frame: TUM, with the clock of the scans"
    ] = None
    view: Annotated[str | None, "[HOST:]PORT", "show the run in the browser until Ctrl-C (default port: 8080)"] = None
    rerun: Annotated[Path | None, "FILE", "write a recording (.rrd) for the Rerun viewer"] = None
    strict: Annotated[bool, None, "exit with code 3 unless every scan is anchored and the map is sound"] = False
    verbose: Annotated[bool, None, "print log messages"] = False
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
_READ: dict[str, Callable[[str], Any]] = {"mount": _mount, "start": _start, "tolerance": _tolerance}  # with checks
_GROUPS = {"scan_dir": "scans", "bim": "building", "config": "settings", "out": "results"}  # by their first options
COMMON = (
    *("bim", "layer", "storey", "start", "control", "tolerance", "map", "stamp", "mount"),
    *("config", "set", "out", "ground_truth", "verbose"),
)
ANCHORING = (*COMMON, "topic", "single_pass", "view", "rerun", "strict")  # of scans that are all there
OF_A_RUN = (*ANCHORING, "scan_dir", "odometry", "imu", "imu_topic", "demo", "seed", "resume")


def add_options(parser: argparse.ArgumentParser, *names: str, **changes: dict[str, Any]) -> None:
    """Adds the options of these names; `changes` are arguments of `add_argument` for some, with `flag` for another name
    on the command line."""
    kinds, is_long = get_type_hints(RunOptions, include_extras=True), len(names) + len(changes) > 5
    title, groups = "", dict[str, argparse._ArgumentGroup]()
    for name in _FIELDS:
        title = _GROUPS.get(name, title)
        if name not in names and name not in changes:
            continue
        if is_long and title not in groups:
            groups[title] = parser.add_argument_group(title)
        kind, metavar, about = get_args(kinds[name])
        given: dict[str, Any] = {"help": about, **_kind(name, kind, metavar), **changes.get(name, {})}
        flag = given.pop("flag", f"--{name.replace('_', '-')}")
        if flag.startswith("-"):
            given["dest"] = name
        if given.get("required") or not flag.startswith("-"):
            given["help"] = given["help"].partition(" (default")[0]
        (groups[title] if is_long else parser).add_argument(flag, **given)


def _kind(name: str, kind: Any, metavar: str | None) -> dict[str, Any]:
    """The arguments of `add_argument` that a field's type and default say."""
    default, first = _FIELDS[name].default, get_args(kind)[0] if get_args(kind) else kind
    if default is False:
        return {"action": "store_true"}
    if default == ():
        return {"action": "append", "default": [], "metavar": metavar}
    if get_origin(first) is Literal:
        return {"choices": get_args(first)}
    optional = {"nargs": "?", "const": "8080"} if name == "view" else {}
    return {"type": _READ.get(name, first), "default": default, "metavar": metavar, **optional}
