"""A run's folder: everything that a run leaves, each file written whole or not at all."""

import errno
import logging
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from data import SceneGraph, UserError
from data.common.files import write_atomically, write_json
from data.geometry.poses import xyzquat_to_poses
from data.trajectory import Trajectory
from sgslam.backend.pose_graph import FILE as POSE_GRAPH
from sgslam.backend.pose_graph import write_pose_graph
from sgslam.config.loading import save_config
from sgslam.mapping.keyframe_clouds import FILE as CLOUDS
from sgslam.report.contents import ReportData

if TYPE_CHECKING:
    from matching.result import MatchesFile
    from sgslam.session.result import Result

_log = logging.getLogger(__name__)


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
    result: "Result", out: Path, *, a_graph: SceneGraph | None = None, truth: Trajectory | None = None,
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
    result: "Result", out: Path, a_graph: SceneGraph | None, truth: Trajectory | None, more: dict[str, Any] | None
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
    result: "Result", out: Path, a_graph: SceneGraph | None, truth: Trajectory | None, metrics: dict[str, Any]
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
