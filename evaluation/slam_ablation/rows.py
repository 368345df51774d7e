"""One run of the ablation as a row of numbers, computed from the run's result."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from data.common.errors import UserError
from data.scene_graph import SceneGraph
from data.trajectory import Trajectory
from evaluation.harness import Sequence
from evaluation.drives.sequences import storey_of
from evaluation.metrics.maps import room_scores, wall_scores
from evaluation.metrics.matches import matching_scores
from evaluation.metrics.trajectories import drift, error_in_bim, matched, rpe
from evaluation.metrics.true_matches import true_matches
from matching import MatchResult
from sgslam.session import Result

RPE_M = 1.0


@dataclass(frozen=True, kw_only=True)
class Row:
    """One run. Errors are in the BIM frame without alignment, over all scans; None if there is nothing to measure.

    `drift_reduction` is relative to the same graph without anchors. Walls and rooms compare the S-graph with the
    storey's A-graph under the true motion; their recall is over the rooms that were entered. Matches are those of the
    final answer. `seconds` excludes loading the plan; `peak_memory_mb` is that of the whole process.
    """

    sequence: str
    conditions: str
    seed: int
    arm: str
    anchored: bool
    rmse_bim_m: float | None = None
    max_bim_m: float | None = None
    horizontal_rmse_m: float | None = None
    height_rmse_m: float | None = None
    yaw_rmse_deg: float | None = None
    drift_reduction: float | None = None
    rpe_1m_m: float | None = None
    drift_percent: float | None = None
    matched_poses: int = 0
    total_poses: int = 0
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
    scans: int = 0
    keyframes: int | None = None
    rooms: int | None = None
    wall_surfaces: int | None = None
    seconds: float = 0.0
    seconds_reading: float | None = None
    seconds_odometry: float | None = None
    seconds_surfaces: float | None = None
    seconds_rooms: float | None = None
    seconds_loops: float | None = None
    seconds_matching: float | None = None
    seconds_optimisation: float | None = None
    peak_memory_mb: float | None = None
    weakening: str = ""
    reason: str = ""
    config: str = ""
    command: str = ""


COLUMNS = tuple(f.name for f in fields(Row))
KEY = ("sequence", "conditions", "seed", "arm")
Record = dict[str, str]  # a row as the CSV has it
Records = list[Record]


def as_record(row: Row) -> Record:
    """The row as CSV values by column; empty for None."""
    return {name: "" if (value := getattr(row, name)) is None else str(value) for name in COLUMNS}


def errors_file(out: Path, record: Record) -> Path:
    """The file of a run's errors over time."""
    return out / "errors" / ("_".join(record[k].replace(" ", "-").replace(":", "-") for k in KEY) + ".csv")


def trajectory_numbers(estimate: Trajectory | None, truth: Trajectory) -> dict[str, Any]:
    """The columns on the trajectory in the BIM frame; empty without an estimate."""
    if estimate is None:
        return {}
    error = error_in_bim(estimate, truth)
    relative: float | None = None
    percent: float | None = None
    try:
        relative = rpe(estimate, truth, RPE_M).translation.rmse
        travelled = drift(estimate, truth)
        percent = travelled.end_percent if travelled.mean_percent is None else travelled.mean_percent
    except UserError:
        pass  # a robot that stood still has no relative error, and the row leaves it empty
    return {
        "rmse_bim_m": error.position.rmse, "max_bim_m": error.position.max,
        "horizontal_rmse_m": error.horizontal.rmse, "height_rmse_m": error.height.rmse,
        "yaw_rmse_deg": float(np.degrees(error.yaw.rmse)), "rpe_1m_m": relative, "drift_percent": percent,
        "matched_poses": error.matched_poses,
    }  # fmt: skip


def errors_over_time(estimate: Trajectory, truth: Trajectory) -> NDArray[np.float64]:
    """(M, 2) seconds since the first scan and the position error in metres."""
    both = matched(estimate, truth)
    error = np.linalg.norm(both.estimate[:, :3, 3] - both.truth[:, :3, 3], axis=1)
    return np.column_stack([(both.stamps_ns - estimate.stamps_ns[0]) / 1e9, error])


def map_numbers(result: Result, sequence: Sequence) -> dict[str, Any]:
    """The columns on the map and the matches."""
    T_bim_map = sequence.truth.poses[0]
    floor = sequence.a_graph.on_floor(storey_of(sequence.a_graph, T_bim_map))
    entered = _entered(floor, sequence.truth)
    seen = {w.id for w in floor.wall_surfaces if w.room in entered}
    walls = wall_scores(result.s_graph, floor, T_bim_map, seen or None)
    rooms = room_scores(result.s_graph, floor, T_bim_map, entered or None)
    return {
        "wall_precision": walls.score.precision, "wall_recall": walls.score.recall,
        "wall_offset_mm": None if walls.offset_mm is None else walls.offset_mm.median,
        "wall_angle_deg": None if walls.angle_deg is None else walls.angle_deg.median,
        "room_precision": rooms.score.precision, "room_recall": rooms.score.recall,
        "room_centroid_m": None if rooms.centroid is None else rooms.centroid.median,
        "keyframes": result.keyframes, "rooms": len(result.s_graph.rooms),
        "wall_surfaces": len(result.s_graph.wall_surfaces), **_match_numbers(result, floor, T_bim_map),
    }  # fmt: skip


def _match_numbers(result: Result, floor: SceneGraph, T_bim_map: NDArray[np.float64]) -> dict[str, Any]:
    if result.matches is None or not result.anchored:
        return {}
    pairs: dict[str, tuple[tuple[str, str, float], ...]] = {}
    answers = {"rooms": result.matches["rooms"], "wall_surfaces": result.matches["wall_surfaces"]}
    for kind, found in answers.items():
        # the first of several answers
        first = {str(s): (str(s), str(a), float(c)) for s, a, c in reversed(found)}
        pairs[kind] = tuple(first.values())
    answer = MatchResult("unique", "", pairs["rooms"], pairs["wall_surfaces"])
    truth = true_matches(result.s_graph, floor, T_bim_map)
    score = matching_scores(answer, truth, result.s_graph).wall_surfaces
    return {"match_precision": score.precision, "match_recall": score.recall, "match_f1": score.f1}


def _entered(floor: SceneGraph, truth: Trajectory) -> set[str]:
    """The ids of a storey's rooms in which the sensor has been."""
    places = shapely.points(truth.positions[::5, :2])
    areas = {r.id: shapely.Polygon(r.polygon) for r in floor.rooms if r.polygon is not None and len(r.polygon) > 2}
    return {key for key, area in areas.items() if shapely.contains(area, places).any()}
