"""What a run gives: trajectories of all scans, the S-graph, the matches, deviations, metrics; and its folder."""

import errno
import logging
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph, UserError
from data.common.files import write_atomically, write_json
from data.geometry.poses import poses_to_xyzquat, xyzquat_to_poses
from data.trajectory import Trajectory
from sgslam.anchoring.anchor_log import AnchorEntry
from sgslam.as_built.deviation_entries import Deviation
from sgslam.backend.factor_log import FactorLog
from sgslam.backend.pose_graph import FILE as POSE_GRAPH
from sgslam.backend.pose_graph import write_pose_graph
from sgslam.config import Config
from sgslam.config.loading import save_config
from sgslam.mapping.keyframe_clouds import FILE as CLOUDS
from sgslam.mapping.keyframe_clouds import KeyframeClouds
from sgslam.report.contents import ReportData

if TYPE_CHECKING:
    from matching.result import MatchesFile  # loads the matchers

_log = logging.getLogger(__name__)
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Returned:
    """Whether a run was found in the map of earlier ones, so many seconds after its start, and why."""

    found: bool
    found_s: float | None
    reason: str


@dataclass(frozen=True)
class Update:
    """What is known right after a scan.

    `T_map_sensor` (4, 4) is the sensor's pose in the map frame (metres) at `stamp_ns` (nanoseconds). It is not smoothed
    yet: the poses of a finished run are in `Result`. `keyframes` is how many there are so far, `anchored` whether the
    map has its place in the plan.
    """

    stamp_ns: int
    T_map_sensor: Floats
    keyframes: int
    anchored: bool


@dataclass(frozen=True, eq=False)
class PoseCovariances:
    """`trajectory`: some keyframes, evenly over the run, T_bim_sensor; `covariances` (N, 6, 6) of their poses, rotation
    first (rad), then translation (m), in the sensor's axes."""

    trajectory: Trajectory
    covariances: Floats


@dataclass(frozen=True)
class Result:
    """A finished run, in metres, radians and seconds.

    `anchored` says whether the map has its place in the plan, `reason` why or why not, in one line. `trajectory` is in
    the BIM frame when `anchored`, else in the map frame, as `trajectory_map` always is; `trajectory_odometry` is the
    odometry alone, in its own frame. `T_bim_map` (4, 4) is the map's pose in the BIM frame, None where the run is not
    anchored. `s_graph` is in the map frame, `a_graph` in the BIM frame, None where no plan was given. `matches` has the
    form of matches.json, None where nothing was matched; `deviations` has that of deviations.json, empty where the run
    is not anchored. `first_anchor_s` is counted from the first scan. `seconds` is the time that each stage took.
    """

    anchored: bool
    reason: str
    trajectory: Trajectory
    trajectory_map: Trajectory
    trajectory_odometry: Trajectory
    T_bim_map: Floats | None
    s_graph: SceneGraph
    a_graph: SceneGraph | None
    matches: "MatchesFile | None"
    deviations: list[Deviation]
    anchors: list[AnchorEntry]  # the log: each with who added it, and what became of it when and why
    factors: FactorLog  # of the back end: all that hold, and what was added and withdrawn by whom and why
    pose_covariances: PoseCovariances | None  # where the run was anchored
    first_anchor_s: float | None
    keyframes: int
    seconds: dict[str, float]
    config: Config
    clouds: KeyframeClouds  # by the number of the keyframe, `k<number>` in the S-graph
    earlier: tuple[Trajectory, ...] = ()  # of the runs that the map was joined to, in the frame of `trajectory`
    returned: Returned | None = None  # where there was a prior map

    def save(self, out: Path | str) -> None:
        """Writes the run's folder: trajectories, graphs, matches, deviations, metrics, configuration, report."""
        save_result(self, prepare_folder(Path(out)))

    def metrics(self) -> dict[str, Any]:
        """The form of metrics.json, without what only the command knows."""
        T = self.T_bim_map
        return {
            "anchored": self.anchored,
            "reason": self.reason,
            "T_bim_map": None if T is None else poses_to_xyzquat(T[None])[0].tolist(),
            "scans": len(self.trajectory),
            "scans_skipped": 0,
            "keyframes": self.keyframes,
            "rooms": len(self.s_graph.rooms),
            "wall_surfaces": len(self.s_graph.wall_surfaces),
            "first_anchor_s": self.first_anchor_s,
            "seconds": self.seconds,
            "runs": len(self.earlier) + 1,
            "returned": None if self.returned is None else asdict(self.returned),
        }


def prepare_folder(path: Path) -> Path:
    """Makes the out folder; raises UserError where it cannot be written to."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        write_atomically(path / ".writable", "")
        (path / ".writable").unlink()
    except OSError as error:
        raise UserError(f"{path}: cannot be written to ({error.strerror}); give another --out") from None
    return path


def save_result(
    result: Result, out: Path, *, a_graph: SceneGraph | None = None, truth: Trajectory | None = None,
    more: dict[str, Any] | None = None,
) -> dict[str, Any]:  # fmt: skip
    """Writes the folder's files by the contract, and returns what went into metrics.json.

    `a_graph` is the whole building's where the run was restricted to a part; `more` is merged into the metrics. Where
    the disk is full the keyframes' clouds give way to the results; raises UserError where that is not enough.
    """
    for room in (False, True):
        try:
            return _save(result, out, a_graph or result.a_graph, truth, more)
        except OSError as error:
            if error.errno not in (errno.ENOSPC, errno.EDQUOT):
                raise
            if not room:
                _log.warning("%s: the disk is full; the clouds of keyframes give way to the results", out)
                result.clouds.give_way()
    raise UserError(f"{out}: the disk is full, some of the results are not there; make room and run it again")


def _save(
    result: Result, out: Path, a_graph: SceneGraph | None, truth: Trajectory | None, more: dict[str, Any] | None
) -> dict[str, Any]:
    result.trajectory.write_tum(out / "trajectory.tum")
    result.trajectory_map.write_tum(out / "trajectory_map.tum")
    result.trajectory_odometry.write_tum(out / "trajectory_odometry.tum")
    for number, earlier in enumerate(result.earlier, 1):
        earlier.write_tum(out / f"trajectory_run{number}.tum")
    result.s_graph.save(out / "s_graph.json")
    if a_graph is not None:
        a_graph.save(out / "a_graph.json")
    write_json(out / "matches.json", result.matches or _no_match(result.reason))
    write_json(out / "deviations.json", result.deviations)
    write_atomically(out / "config.yaml", save_config(result.config))
    result.clouds.copy_to(out / CLOUDS)
    poses = xyzquat_to_poses(np.array([keyframe.pose for keyframe in result.s_graph.keyframes]))
    write_pose_graph(out / POSE_GRAPH, result.factors, poses if result.T_bim_map is None else result.T_bim_map @ poses)
    metrics = {**result.metrics(), **(more or {})}
    seconds = dict(metrics["seconds"])
    began = perf_counter()
    _write_report(result, out, a_graph, truth, metrics)
    seconds["report"] = perf_counter() - began
    seconds["total"] = seconds.get("total", sum(result.seconds.values())) + seconds["report"]
    metrics["seconds"] = {name: round(value, 4) for name, value in seconds.items()}
    write_json(out / "metrics.json", metrics)
    return metrics


def _write_report(
    result: Result, out: Path, a_graph: SceneGraph | None, truth: Trajectory | None, metrics: dict[str, Any]
) -> None:
    # drawing libraries are slow to load and only needed here
    from sgslam.report.page import write_report
    from sgslam.report.plan_png import write_plan_png

    if truth is not None:  # it may go on after the run, to other storeys
        truth = truth.between(result.trajectory_map)
    data = ReportData(
        a_graph, result.s_graph, result.trajectory_map, result.trajectory_odometry, truth, result.T_bim_map,
        result.matches, metrics, result.deviations,
    )  # fmt: skip
    write_report(data, out / "report.html")
    write_plan_png(data, out / "plan.png")


def _no_match(reason: str) -> "MatchesFile":
    return {
        "status": "none", "reason": reason, "rooms": [], "wall_surfaces": [], "T_a_s": None, "floor": None,
        "hypotheses": [], "seconds": 0.0,
    }  # fmt: skip
