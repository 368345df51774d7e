"""The record of a run of the ablation."""

import logging
import re
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import shapely
from numpy.typing import NDArray

from data.common.errors import UserError
from data.scans import ScanFolder
from data.scene_graph import SceneGraph
from data.trajectory import Trajectory
from evaluation.drives import Sequence
from evaluation.drives.sequences import storey_of
from evaluation.harness import Cost, Record
from evaluation.metrics.maps import room_scores, wall_scores
from evaluation.metrics.matches import matching_scores
from evaluation.metrics.regions import Inside, inside
from evaluation.metrics.statistics import Statistics
from evaluation.metrics.trajectories import drift, error_in_bim, matched, origin_alignment, rpe
from evaluation.metrics.true_matches import true_matches
from matching import MatchResult
from sgslam.session import Result

_log = logging.getLogger(__name__)
RPE_M = 1.0
CURVE = 200  # most points of the error over time
Curve = Annotated[tuple[float, ...], "cost"]  # not compared between runs: the RMSE is


class Scores(Record):
    """Errors are in the BIM frame without alignment, over `matched_poses` of the drive's scans (`poses`); None if there
    is nothing to measure.

    Walls and rooms compare the S-graph with the storey's A-graph under the true motion; their recall is over the rooms
    that were entered. Matches are those of the final answer. `inside` says how often the 95 % regions hold the errors.
    `driven_m` is the length of the drive. `seconds` excludes loading the plan; `peak_memory_mb` is that of the whole
    process. `times_s` (from the first scan) and `errors_m` are
    the error over time, thinned out. `weakening` says how the front end was weakened; variants that use odometry of
    their own, or none, have the short range only.
    """

    anchored: bool
    rmse_m: float | None = None
    max_m: float | None = None
    horizontal_rmse_m: float | None = None
    height_rmse_m: float | None = None
    yaw_rmse_deg: float | None = None
    rpe_1m_m: float | None = None
    drift_percent: float | None = None
    matched_poses: int = 0
    poses: int
    driven_m: float
    first_anchor_s: float | None = None
    wall_precision: float | None = None
    wall_recall: float | None = None
    wall_offset_mm: float | None = None
    wall_angle_deg: float | None = None
    room_precision: float | None = None
    room_recall: float | None = None
    room_centroid_m: float | None = None
    match_precision: float | None = None
    match_recall: float | None = None
    match_f1: float | None = None
    keyframes: int | None = None
    rooms: int | None = None
    wall_surfaces: int | None = None
    inside: Inside | None = None
    seconds: Cost
    seconds_reading: Cost
    seconds_odometry: Cost = None
    seconds_surfaces: Cost = None
    seconds_rooms: Cost = None
    seconds_loops: Cost = None
    seconds_matching: Cost = None
    seconds_optimisation: Cost = None
    peak_memory_mb: Cost
    weakening: str = ""
    reason: str = ""
    times_s: Curve = ()
    errors_m: Curve = ()


def scores_of(
    sequence: Sequence, estimate: Trajectory | None, result: Result | None, seconds: float, reading: float
) -> Scores:
    """The record of a run with this T_bim_sensor, None if it is not anchored, and this result, None without a map.

    `reading` is how many of the `seconds` went into reading the scans.
    """
    own, truth, scans = (
        {} if result is None else _of_run(result, sequence),
        sequence.truth,
        ScanFolder(sequence.scan_dir),
    )
    steps = np.diff(truth.positions, axis=0)
    return Scores(
        **{"anchored": False, "poses": len(scans), **own, **_of_trajectory(estimate, truth)},
        driven_m=float(np.linalg.norm(steps, axis=1).sum()), seconds=seconds, seconds_reading=reading,
        peak_memory_mb=_peak_memory_mb(), weakening="" if sequence.weak is None else sequence.weak.describe(),
    )  # fmt: skip


def _of_trajectory(estimate: Trajectory | None, truth: Trajectory) -> dict[str, Any]:
    if estimate is None:
        return {}
    error = error_in_bim(estimate, truth)
    times, errors = _error_over_time(estimate, truth)
    return {
        **_of_motion(estimate, truth), "rmse_m": error.position.rmse, "max_m": error.position.max,
        "horizontal_rmse_m": error.horizontal.rmse, "height_rmse_m": error.height.rmse,
        "yaw_rmse_deg": float(np.degrees(error.yaw.rmse)), "matched_poses": error.matched_poses,
        "times_s": times, "errors_m": errors,
    }  # fmt: skip


def _of_motion(estimate: Trajectory, truth: Trajectory) -> dict[str, float | None]:
    """The relative errors; None, with a warning, where the robot moved too little for one."""
    found: dict[str, float | None] = {}
    for name, measure in (("rpe_1m_m", _rpe), ("drift_percent", _drift_percent)):
        try:
            found[name] = measure(estimate, truth)
        except UserError as error:
            _log.warning("%s is not measured: %s", name, error)
            found[name] = None
    return found


def _rpe(estimate: Trajectory, truth: Trajectory) -> float:
    return rpe(estimate, truth, RPE_M).translation.rmse


def _drift_percent(estimate: Trajectory, truth: Trajectory) -> float:
    travelled = drift(estimate, truth)
    return travelled.end_percent if travelled.mean_percent is None else travelled.mean_percent


def _error_over_time(estimate: Trajectory, truth: Trajectory) -> tuple[list[float], list[float]]:
    both = matched(estimate, truth)
    kept = np.unique(np.linspace(0, len(both.stamps_ns) - 1, CURVE).round().astype(int))
    error = np.linalg.norm(both.estimate[kept, :3, 3] - both.truth[kept, :3, 3], axis=1)
    seconds = (both.stamps_ns[kept] - truth.stamps_ns[0]) / 1e9
    return seconds.round(3).tolist(), error.round(4).tolist()


def _of_run(result: Result, sequence: Sequence) -> dict[str, Any]:
    T_bim_map = origin_alignment(result.trajectory_map, sequence.truth)
    floor = sequence.a_graph.on_floor(storey_of(sequence.a_graph, T_bim_map))
    entered = _entered(floor, sequence.truth)
    seen = {w.id for w in floor.wall_surfaces if w.room in entered}
    walls = wall_scores(result.s_graph, floor, T_bim_map, seen or None)
    rooms = room_scores(result.s_graph, floor, T_bim_map, entered or None)
    return {
        "anchored": result.anchored, "first_anchor_s": result.first_anchor_s,
        "reason": result.reason, **{f"seconds_{stage}": spent for stage, spent in result.seconds.items()},
        "wall_precision": walls.score.precision, "wall_recall": walls.score.recall,
        "wall_offset_mm": _median(walls.offset_mm), "wall_angle_deg": _median(walls.angle_deg),
        "room_precision": rooms.score.precision, "room_recall": rooms.score.recall,
        "room_centroid_m": _median(rooms.centroid), "keyframes": result.keyframes, "rooms": len(result.s_graph.rooms),
        "wall_surfaces": len(result.s_graph.wall_surfaces), **_of_matches(result, floor, T_bim_map),
        "inside": inside(result, sequence.truth) if result.anchored else None,
    }  # fmt: skip


def _of_matches(result: Result, floor: SceneGraph, T_bim_map: NDArray[np.float64]) -> dict[str, Any]:
    if result.matches is None or not result.anchored:
        return {}
    found = (result.matches["rooms"], result.matches["wall_surfaces"])
    rooms, walls = (  # the first of several answers
        tuple({str(s): (str(s), str(a), float(c)) for s, a, c in reversed(kind)}.values()) for kind in found
    )
    truth = true_matches(result.s_graph, floor, T_bim_map)
    score = matching_scores(MatchResult("unique", "", rooms, walls), truth, result.s_graph).wall_surfaces
    return {"match_precision": score.precision, "match_recall": score.recall, "match_f1": score.f1}


def _entered(floor: SceneGraph, truth: Trajectory) -> set[str]:
    """The ids of a storey's rooms in which the sensor has been."""
    places = shapely.points(truth.positions[::5, :2])
    areas = {r.id: shapely.Polygon(r.polygon) for r in floor.rooms if r.polygon is not None and len(r.polygon) > 2}
    return {key for key, area in areas.items() if shapely.contains(area, places).any()}


def _median(errors: Statistics | None) -> float | None:
    return None if errors is None else errors.median


def _peak_memory_mb() -> float | None:
    """Peak memory (MB) of this process, from /proc; `getrusage` would include the parent of a fork."""
    try:
        status = Path("/proc/self/status").read_text()
    except OSError:
        return None
    found = re.search(r"^VmHWM:\s+(\d+) kB", status, re.MULTILINE)
    return int(found.group(1)) / 1024 if found else None
