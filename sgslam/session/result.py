"""The result of a run (trajectories, S-graph, matches, deviations, metrics) and its output folder."""

import errno
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph, UserError
from data.common.files import write_atomically, write_json
from data.geometry.poses import poses_to_xyzquat, xyzquat_to_poses
from data.trajectory import Trajectory
from sgslam.anchoring import AnchorEntry
from sgslam.as_built import Deviation
from sgslam.as_built.agreement import agreed
from sgslam.as_built.elements import ElementVerdict, UnplannedEntry, unplanned_walls
from sgslam.as_built.elements.files import remove_elements, write_elements
from sgslam.backend import FactorLog, write_pose_graph
from sgslam.backend.pose_graph import FILE as POSE_GRAPH
from sgslam.config import Config
from sgslam.config.loading import save_config
from sgslam.mapping import KeyframeClouds
from sgslam.mapping.cloud_map import cloud_map
from sgslam.mapping.keyframe_clouds import FILE as CLOUDS
from sgslam.registration import Health
from sgslam.report import ReportData, RunFolder
from sgslam.report.elements import shown_as_element
from sgslam.session.soundness.quality import Quality
from sgslam.session.soundness.scan_uncertainty import FILE as SIGMA
from sgslam.session.soundness.scan_uncertainty import ScanUncertainty

if TYPE_CHECKING:
    from matching.result import MatchesFile  # loads the matchers

_log = logging.getLogger(__name__)
Elements = Callable[[], Sequence[ElementVerdict] | None]  # the verdicts on the planned elements; None without any
LIVE = "trajectory_live.tum"
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Relocalisation:
    """Whether a run was relocalised in the prior map, `found_s` seconds after its start, and the reason. `found_s` is
    None if it was not, or only after the last scan."""

    found: bool
    found_s: float | None
    reason: str


@dataclass(frozen=True)
class Update:
    """The live estimate right after a scan.

    `T_map_sensor` (4, 4) is the sensor's pose in the map frame (metres) at `stamp_ns` (nanoseconds). It is not smoothed
    yet, and provisional until gravity is known and while scans are lost; `Result` has the final poses. `keyframes` is
    the number of keyframes so far, `anchored` whether the map is anchored to the plan. `T_bim_sensor` (4, 4) is the
    pose in the BIM frame, None while the map is not anchored; `health` is the tracker's verdict on the newest scan,
    None while it waits. After a longer loss it stays lost until a place that looks alike is ruled out.
    `SceneGraphSlam.sigma` gives the standard deviations of the pose.
    """

    stamp_ns: int
    T_map_sensor: Floats
    keyframes: int
    anchored: bool
    T_bim_sensor: Floats | None = None
    health: Health | None = None


@dataclass(frozen=True, eq=False)
class PoseCovariances:
    """Covariances of some keyframe poses, evenly spaced over the run.

    `trajectory` holds T_bim_sensor of these keyframes; `covariances` (N, 6, 6) are rotation first (rad), then
    translation (m), in the sensor's axes.
    """

    trajectory: Trajectory
    covariances: Floats


@dataclass(frozen=True)
class Result:
    """A finished run, in metres, radians and seconds.

    `anchored` says whether the map is anchored to the plan, `reason` why or why not, in one line. `trajectory` is in
    the BIM frame when `anchored`, and has the anchored scans only: no lost ones, none of submaps that were not
    relocalised, and none whose pose is too uncertain. Otherwise it is `trajectory_map`, which always has all scans, in
    the map frame. `trajectory_odometry` is the odometry alone, in its own frame. `trajectory_live` has the scans of
    `trajectory`, in its frame, with the poses that were estimated when the scans arrived; None without a second pass.
    `T_bim_map` (4, 4) is the map's pose in the BIM frame, None if the run is not anchored. `s_graph` is in the map
    frame; `a_graph` is in the BIM frame, None without a plan. `matches` has the form of matches.json, None if nothing
    was matched; `deviations` has the form of deviations.json, empty if the run is not anchored. `anchors` is the log of
    all anchors: what added each, and when and why it changed. `factors` is the back end's log: the active factors, and
    those added and withdrawn. `clouds` are indexed by keyframe number, `k<number>` in the S-graph. `first_anchor_s`
    counts from the first scan. `seconds` is the time of each stage. `earlier` are the trajectories of the prior map's
    runs, in the frame of `trajectory`. `pose_covariances` is None if the run is not anchored, `relocalisation` is None
    without a prior map. `tracked` is the number of good, degraded and lost scans; `uncertainty` has a line for each
    scan, and `quality` says whether the map is sound. `advice` has a line for each thing that seems wrong with the
    scans or with what the user stated about them.
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
    anchors: list[AnchorEntry]
    factors: FactorLog
    pose_covariances: PoseCovariances | None
    first_anchor_s: float | None
    keyframes: int
    seconds: dict[str, float]
    config: Config
    clouds: KeyframeClouds
    tracked: dict[Health, int]
    uncertainty: ScanUncertainty
    quality: Quality
    earlier: tuple[Trajectory, ...] = ()
    relocalisation: Relocalisation | None = None
    advice: tuple[str, ...] = ()
    trajectory_live: Trajectory | None = None

    def to_open3d(self) -> list[Any]:
        """The map's points, the path of the sensor and the walls, in the frame of `trajectory`, as geometries for
        `open3d.visualization.draw_geometries`. Needs the extra `open3d`; raises UserError without it."""
        from sgslam.cloud_to_model import open3d_scene

        run = RunFolder(Path(), self.s_graph, self.a_graph, self.T_bim_map, {}, [])
        points, _ = cloud_map(self.clouds, run.poses_by_keyframe, self.config.clouds.map_voxel)
        walls = [run.corners(surface) for surface in self.s_graph.wall_surfaces]
        return open3d_scene(points, self.trajectory.positions, walls)

    def save(self, out: Path | str) -> None:
        """Writes all results to the folder `out`. Raises UserError if it cannot be written to or the disk is full."""
        save_result(self, prepare_folder(Path(out)))

    def metrics(self) -> dict[str, Any]:
        """The content of metrics.json, without the fields that the command line adds."""
        T = self.T_bim_map
        return {
            "anchored": self.anchored,
            "reason": self.reason,
            "anchored_share": float(self.uncertainty.anchored.mean()),
            "quality": {name: asdict(signal) for name, signal in self.quality.items()},
            "T_bim_map": None if T is None else poses_to_xyzquat(T[None])[0].tolist(),
            "scans": len(self.trajectory_map),
            "scans_skipped": 0,
            "tracked": dict(self.tracked),
            "keyframes": self.keyframes,
            "floors": len(self.s_graph.floors),
            "rooms": len(self.s_graph.rooms),
            "wall_surfaces": len(self.s_graph.wall_surfaces),
            "first_anchor_s": self.first_anchor_s,
            "seconds": self.seconds,
            "runs": len(self.earlier) + 1,
            "returned": None if self.relocalisation is None else asdict(self.relocalisation),
            "advice": list(self.advice),
        }


def prepare_folder(path: Path) -> Path:
    """Creates the output folder. Raises UserError if it cannot be written to."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        write_atomically(path / ".writable", "")
        (path / ".writable").unlink()
    except OSError as error:
        raise UserError(f"{path}: cannot write to this folder ({error.strerror}); give another --out") from None
    return path


def save_result(
    result: Result, out: Path, *, a_graph: SceneGraph | None = None, truth: Trajectory | None = None,
    more: dict[str, Any] | None = None, elements: Elements = lambda: None,
) -> dict[str, Any]:  # fmt: skip
    """Writes the files of the output folder; returns the content of metrics.json.

    `a_graph` is the whole building's graph if the run was restricted to a part of it; `more` is merged into the
    metrics. `elements` is called when the results of the run itself are written. If the disk is full, the keyframe
    clouds are deleted to make room. Raises UserError if that is not enough.
    """
    for room in (False, True):
        try:
            return _save(result, out, a_graph or result.a_graph, truth, more or {}, elements)
        except OSError as error:
            if error.errno not in (errno.ENOSPC, errno.EDQUOT):
                raise
            if not room:
                _log.warning("%s: the disk is full; the keyframe clouds are deleted to make space for the results", out)
                result.clouds.give_way()
    raise UserError(f"{out}: the disk is full and some results are missing; free some space and run it again")


def _save(
    result: Result, out: Path, a_graph: SceneGraph | None, truth: Trajectory | None, more: dict[str, Any],
    elements: Elements,
) -> dict[str, Any]:  # fmt: skip
    result.trajectory.write_tum(out / "trajectory.tum")
    result.trajectory_map.write_tum(out / "trajectory_map.tum")
    result.trajectory_odometry.write_tum(out / "trajectory_odometry.tum")
    if result.trajectory_live is None:
        (out / LIVE).unlink(missing_ok=True)  # that of an earlier run in this folder
    else:
        result.trajectory_live.write_tum(out / LIVE)
    result.uncertainty.write_csv(out / SIGMA)
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
    metrics = {**result.metrics(), **more}
    seconds = metrics["seconds"] = dict(metrics["seconds"])
    began = perf_counter()
    verdicts, unplanned = elements(), list[UnplannedEntry]()
    if verdicts is None:
        remove_elements(out)
    else:
        unplanned = _unplanned(result, a_graph)
        write_elements(out, verdicts, result.config.as_built.tolerance, unplanned)
        result = replace(result, deviations=agreed(result.deviations, verdicts))
        write_json(out / "deviations.json", result.deviations)
        seconds["elements"] = perf_counter() - began
    # the report tells the total, so its own time is not in it
    seconds["total"] = seconds.get("total", sum(result.seconds.values())) + perf_counter() - began
    compared = perf_counter()
    shown = [*map(asdict, verdicts or ()), *(shown_as_element(asdict(wall)) for wall in unplanned)]
    _write_report(result, out, a_graph, truth, metrics, shown)
    seconds["report"] = perf_counter() - compared
    metrics["seconds"] = {name: round(value, 4) for name, value in seconds.items()}
    write_json(out / "metrics.json", metrics)
    return metrics


def _unplanned(result: Result, a_graph: SceneGraph | None) -> list[UnplannedEntry]:
    if result.T_bim_map is None or a_graph is None:
        return []
    return unplanned_walls(result.deviations, result.s_graph, result.T_bim_map, result.matches, a_graph)


def _write_report(
    result: Result, out: Path, a_graph: SceneGraph | None, truth: Trajectory | None, metrics: dict[str, Any],
    elements: Sequence[Mapping[str, Any]],
) -> None:  # fmt: skip
    # the drawing libraries are slow to import and needed only here
    from sgslam.report.page import write_report
    from sgslam.report.plan_png import write_plan_png

    if truth is not None:  # the truth may continue after the run, on other storeys
        truth = truth.between(result.trajectory_map)
    data = ReportData(
        a_graph, result.s_graph, result.trajectory_map, result.trajectory_odometry, truth, result.T_bim_map,
        result.matches, metrics, result.deviations, result.uncertainty.states(), result.anchors,
        elements=elements,
    )  # fmt: skip
    write_report(data, out / "report.html")
    write_plan_png(data, out / "plan.png")


def _no_match(reason: str) -> "MatchesFile":
    return {
        "status": "none", "reason": reason, "rooms": [], "wall_surfaces": [], "T_a_s": None, "floor": None,
        "hypotheses": [], "seconds": 0.0,
    }  # fmt: skip
