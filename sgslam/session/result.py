"""The result of a run (trajectories, S-graph, matches, deviations, metrics) and its output folder."""

import errno
import logging
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
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
from data.plans.bodies import PlannedElement, bodies_of, gaps_of
from data.trajectory import Trajectory
from data.trajectory.correction import moved_with
from sgslam.anchoring import AnchorEntry
from sgslam.as_built import AnchoredMap, Assessment, Deviation, assess
from sgslam.as_built.elements.files import remove_elements, write_elements
from sgslam.as_built.findings import remove_topics, write_topics
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
from sgslam.session.place_report import PlaceReport
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
    was matched. `anchors` is the log of
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
    place: PlaceReport | None = None
    earlier: tuple[Trajectory, ...] = ()
    relocalisation: Relocalisation | None = None
    advice: tuple[str, ...] = ()
    trajectory_live: Trajectory | None = None
    plan_file: Path | None = None
    given: Trajectory | None = None
    slam: Resumable | None = None

    @property
    def deviations(self) -> list[Deviation]:
        """The content of deviations.json; empty if the run is not anchored."""
        return list(self.assessment.deviations)

    @cached_property
    def assessment(self) -> Assessment:
        """What was found of the planned elements, and what no plan shows; empty if the run is not anchored.

        It is computed when first asked for. The elements are those of `plan_file`, if that is an IFC model, else the
        walls and levels of `a_graph`. Raises UserError for a model that cannot be read any more.
        """
        if self.T_bim_map is None or self.a_graph is None:
            return Assessment()
        views = keyframe_views(self.s_graph, self.T_bim_map, self.uncertainty, self.clouds)
        run = AnchoredMap(self.s_graph, self.a_graph, self.T_bim_map, self.matches, views)
        return assess(run, *self._planned(), self.config.as_built.tolerance, self.config.anchors.sigma_extraction)

    def _planned(self) -> tuple[Sequence[PlannedElement], Floats]:
        """The elements of the plan, and the bodies (M, 3, 3) of what else it shows."""
        if self.plan_file is not None and self.plan_file.suffix.lower() in IFC_SUFFIXES:
            from data.plans.elements import other_bodies, planned_elements  # loads ifcopenshell

            return planned_elements(self.plan_file), other_bodies(self.plan_file)
        assert self.a_graph is not None
        return bodies_of(self.a_graph), gaps_of(self.a_graph)

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

        Of an anchored run, that includes what was found of the planned elements.
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
            "place": None if self.place is None else self.place.to_dict(),
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
                result.clouds.make_room()
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

    Returns the result, and the elements of the report, None if the run is not anchored. An IFC model that cannot be
    read any more becomes advice in `metrics`, and the elements are those of the A-graph.
    """
    a_graph = result.a_graph
    if result.T_bim_map is None or a_graph is None:
        remove_elements(out)
        remove_topics(out)
        write_json(out / "deviations.json", [])
        return result, None
    try:
        found = result.assessment
    except UserError as error:
        _log.warning("the elements are those of the A-graph: %s", error)
        metrics["advice"] = [*metrics["advice"], f"the elements are those of the A-graph: {error}"]
        result = replace(result, plan_file=None)
        found = result.assessment
    write_json(out / "deviations.json", found.deviations)
    elements, unplanned = ([asdict(entry) for entry in entries] for entries in (found.elements, found.unplanned))
    name = "" if result.plan_file is None else result.plan_file.name
    write_topics(out, elements, unplanned, a_graph, Model(name))
    write_elements(out, elements, result.config.as_built.tolerance, unplanned)
    return result, [*elements, *(shown_as_element(own) for own in unplanned if own["kind"] == "wall-like")]


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
        "hypotheses": [], "seconds": 0.0, "temperature": 1.0,
    }  # fmt: skip
