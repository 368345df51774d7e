"""Writes the output folder of a run."""

import errno
import logging
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from data import UserError
from data.common.files import write_atomically, write_json
from data.geometry.poses import xyzquat_to_poses
from data.ifc.bcf import Model
from data.trajectory import Trajectory
from data.trajectory.trajectory import moved_with
from sgslam.as_built.elements.files import remove_elements, write_elements
from sgslam.as_built.findings import remove_topics, write_topics
from sgslam.backend import write_pose_graph
from sgslam.backend.held_factors import POSE_GRAPH
from sgslam.config.loading import save_config
from sgslam.mapping.keyframe_clouds import FILE as CLOUDS
from sgslam.report import ReportData
from sgslam.report.elements import shown_as_element
from sgslam.session.soundness.scan_uncertainty import FILE as SIGMA

if TYPE_CHECKING:
    from sgslam.result.result import Result

_log = logging.getLogger(__name__)
LIVE = "trajectory_live.tum"
ALL_POSES = "trajectory_all.tum"


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
    result: "Result", out: Path, *, truth: Trajectory | None = None, more: dict[str, Any] | None = None
) -> dict[str, Any]:
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


def _save(result: "Result", out: Path, truth: Trajectory | None, more: dict[str, Any]) -> dict[str, Any]:
    from matching.result import MatchResult  # loads the matchers

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
    write_json(out / "matches.json", result.matches or MatchResult("none", result.reason).to_dict())
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


def _compare(result: "Result", out: Path, metrics: dict[str, Any]) -> tuple["Result", list[dict[str, Any]] | None]:
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
    result: "Result", out: Path, truth: Trajectory | None, metrics: dict[str, Any], elements: Sequence[dict[str, Any]]
) -> None:
    # the drawing libraries are slow to import and needed only here
    from sgslam.report.page import report_html
    from sgslam.report.plan_png import write_plan_png

    if truth is not None:  # the truth may continue after the run, on other storeys
        truth = truth.between(result.trajectory_map)
    data = ReportData(
        a_graph=result.a_graph,
        s_graph=result.s_graph,
        trajectory_map=result.trajectory_map,
        trajectory_odometry=result.trajectory_odometry,
        truth=truth,
        T_bim_map=result.T_bim_map,
        matches=result.matches,
        metrics=metrics,
        deviations=result.deviations,
        scans=result.uncertainty,
        anchors=result.anchors,
        elements=elements,
        tolerance=result.config.as_built.tolerance,
    )
    write_atomically(out / "report.html", report_html(data))
    write_plan_png(data, out / "plan.png")
