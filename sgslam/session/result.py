"""The result of a run (trajectories, S-graph, matches, deviations, metrics) and its output folder."""

import errno
import logging
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph, UserError
from data.common.files import write_atomically, write_json
from data.geometry.poses import poses_to_xyzquat, xyzquat_to_poses
from data.ifc.bcf import Model
from data.plans.bim import IFC_SUFFIXES
from data.trajectory import Trajectory
from data.trajectory.correction import moved_with
from sgslam.anchoring import AnchorEntry
from sgslam.as_built import Deviation, planned_things, write_topics
from sgslam.as_built.agreement import agreed
from sgslam.as_built.elements import ElementVerdict, element_verdicts, unplanned_walls
from sgslam.as_built.elements.files import remove_elements, write_elements
from sgslam.as_built.findings import remove_topics
from sgslam.backend import FactorLog, write_pose_graph
from sgslam.backend.pose_graph import FILE as POSE_GRAPH
from sgslam.config import Config
from sgslam.config.loading import save_config
from sgslam.mapping import KeyframeClouds
from sgslam.mapping.cloud_map import cloud_map
from sgslam.mapping.keyframe_clouds import FILE as CLOUDS
from sgslam.report import ReportData, RunFolder
from sgslam.report.elements import shown_as_element
from sgslam.session.checkpoints import Checkpoints, Resumable
from sgslam.session.soundness.quality import Quality
from sgslam.session.soundness.scan_uncertainty import FILE as SIGMA
from sgslam.session.soundness.scan_uncertainty import ScanUncertainty
from sgslam.session.views import keyframe_views
from sgslam.types import Health

if TYPE_CHECKING:
    from matching.result import MatchesFile  # loads the matchers

_log = logging.getLogger(__name__)
LIVE = "trajectory_live.tum"
ALL_POSES = "trajectory_all.tum"
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
    scans or with what the user stated about them. `plan_file` is the file that the plan was read from, None if it is
    not known; `given` has all poses of another SLAM system whose scans these are, None without one. `slam` is the
    system that made the result, to save its state.
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
    plan_file: Path | None = None
    given: Trajectory | None = None
    slam: Resumable | None = None

    def to_open3d(self) -> list[Any]:
        """The map's points, the path of the sensor and the walls, in the frame of `trajectory`, as geometries for
        `open3d.visualization.draw_geometries`. Needs the extra `open3d`; raises UserError without it."""
        from sgslam.cloud_to_model import open3d_scene

        run = RunFolder(Path(), self.s_graph, self.a_graph, self.T_bim_map, {}, [])
        points, _ = cloud_map(self.clouds, run.poses_by_keyframe, self.config.clouds.map_voxel)
        walls = [run.corners(surface) for surface in self.s_graph.wall_surfaces]
        return open3d_scene(points, self.trajectory.positions, walls)

    def save(self, out: Path | str) -> None:
        """Writes the folder of a run, but its log. Raises UserError if it cannot be written to or the disk is full.

        With a plan of which `plan_file` is the IFC model, that includes the verdicts on the model's elements, by which
        the deviations that are written also count or do not.
        """
        out = prepare_folder(Path(out))
        save_result(self, out)
        if self.slam is not None:
            Checkpoints(out, {}).write(self.slam, {}, finished=True)

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
    result: Result, out: Path, *, truth: Trajectory | None = None, more: dict[str, Any] | None = None
) -> dict[str, Any]:  # fmt: skip
    """Writes the files of the output folder, but state and log; returns the content of metrics.json.

    `more` is merged into the metrics. If the disk is full, the keyframe clouds are deleted to make room. Raises
    UserError if that is not enough.
    """
    for room in (False, True):
        try:
            return _save(result, out, truth, more or {})
        except OSError as error:
            if error.errno not in (errno.ENOSPC, errno.EDQUOT):
                raise
            if not room:
                _log.warning("%s: the disk is full; the keyframe clouds are deleted to make space for the results", out)
                result.clouds.give_way()
    raise UserError(f"{out}: the disk is full and some results are missing; free some space and run it again")


def _save(result: Result, out: Path, truth: Trajectory | None, more: dict[str, Any]) -> dict[str, Any]:
    result.trajectory.write_tum(out / "trajectory.tum")
    result.trajectory_map.write_tum(out / "trajectory_map.tum")
    result.trajectory_odometry.write_tum(out / "trajectory_odometry.tum")
    everything = None
    if result.given is not None and len(result.trajectory):
        everything = moved_with(result.given, result.trajectory)
    for name, trajectory in ((LIVE, result.trajectory_live), (ALL_POSES, everything)):
        if trajectory is None:
            (out / name).unlink(missing_ok=True)  # that of an earlier run in this folder
        else:
            trajectory.write_tum(out / name)
    result.uncertainty.write_csv(out / SIGMA)
    for number, earlier in enumerate(result.earlier, 1):
        earlier.write_tum(out / f"trajectory_run{number}.tum")
    result.s_graph.save(out / "s_graph.json")
    if result.a_graph is not None:
        result.a_graph.save(out / "a_graph.json")
    write_json(out / "matches.json", result.matches or _no_match(result.reason))
    write_json(out / "deviations.json", result.deviations)
    write_atomically(out / "config.yaml", save_config(result.config))
    result.clouds.copy_to(out / CLOUDS)
    poses = xyzquat_to_poses(np.array([keyframe.pose for keyframe in result.s_graph.keyframes]))
    write_pose_graph(out / POSE_GRAPH, result.factors, poses if result.T_bim_map is None else result.T_bim_map @ poses)
    metrics = {**result.metrics(), **more}
    seconds = metrics["seconds"] = dict(metrics["seconds"])
    began = perf_counter()
    result, shown = _compare(result, out, metrics)
    if shown is not None:
        seconds["elements"] = perf_counter() - began
    # the report tells the total, so its own time is not in it
    seconds["total"] = seconds.get("total", sum(result.seconds.values())) + perf_counter() - began
    compared = perf_counter()
    _write_report(result, out, truth, metrics, shown or [])
    seconds["report"] = perf_counter() - compared
    metrics["seconds"] = {name: round(value, 4) for name, value in seconds.items()}
    write_json(out / "metrics.json", metrics)
    return metrics


def _compare(result: Result, out: Path, metrics: dict[str, Any]) -> tuple[Result, list[dict[str, Any]] | None]:
    """Writes what deviates from the plan, as deviations.json, elements and BCF, or removes what an earlier run left.

    Returns the result with these deviations, and the elements of the report, None without an IFC model. One that cannot
    be read any more becomes advice in `metrics`.
    """
    T_bim_map, a_graph, model = result.T_bim_map, result.a_graph, result.plan_file
    if T_bim_map is None or a_graph is None:
        remove_elements(out)
        remove_topics(out)
        return result, None
    verdicts: list[ElementVerdict] | None = None
    if model is not None and model.suffix.lower() in IFC_SUFFIXES:
        try:
            result = without_planned_things(result, model)
            verdicts = run_verdicts(result, model)
        except UserError as error:
            _log.warning("no verdicts on elements: %s", error)
            metrics["advice"] = [*metrics["advice"], f"no verdicts on elements: {error}"]
    result = replace(result, deviations=agreed(result.deviations, verdicts or ()))
    tolerance = result.config.as_built.tolerance
    unplanned = unplanned_walls(result.deviations, result.s_graph, T_bim_map, result.matches, a_graph)
    write_json(out / "deviations.json", result.deviations)
    name = "" if model is None else model.name
    write_topics(out, result.deviations, unplanned, a_graph, Model(name), tolerance)
    if verdicts is None:
        remove_elements(out)
        return result, None
    write_elements(out, verdicts, tolerance, unplanned)
    return result, [*map(asdict, verdicts), *(shown_as_element(asdict(wall)) for wall in unplanned)]


def run_verdicts(result: Result, ifc: Path) -> list[ElementVerdict]:
    """The verdicts on the elements of an IFC model, of a run that is anchored to it.

    Raises UserError for a model that cannot be read.
    """
    from data.plans.elements import planned_elements  # loads ifcopenshell

    assert result.T_bim_map is not None and result.a_graph is not None
    views = keyframe_views(result.s_graph, result.T_bim_map, result.uncertainty, result.clouds)
    tolerance, shared = result.config.as_built.tolerance, result.config.anchors.sigma_extraction
    return element_verdicts(planned_elements(ifc), views, result.a_graph, tolerance, shared)


def without_planned_things(result: Result, ifc: Path) -> Result:
    """The result without extra walls that are other things of an IFC model, such as stairs and railings.

    Raises UserError for a model that cannot be read.
    """
    if result.T_bim_map is None or all(d["kind"] != "extra" for d in result.deviations):
        return result
    from data.plans.elements import other_bodies  # loads ifcopenshell

    bodies = other_bodies(ifc)
    kept = planned_things.without_planned_things(result.deviations, result.s_graph, result.T_bim_map, bodies)
    return replace(result, deviations=kept)


def _write_report(
    result: Result, out: Path, truth: Trajectory | None, metrics: dict[str, Any], elements: Sequence[Mapping[str, Any]]
) -> None:  # fmt: skip
    # the drawing libraries are slow to import and needed only here
    from sgslam.report.page import write_report
    from sgslam.report.plan_png import write_plan_png

    if truth is not None:  # the truth may continue after the run, on other storeys
        truth = truth.between(result.trajectory_map)
    data = ReportData(
        result.a_graph, result.s_graph, result.trajectory_map, result.trajectory_odometry, truth, result.T_bim_map,
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
