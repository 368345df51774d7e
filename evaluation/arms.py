"""The arms of the ablation: one sequence run with a part of the system left out or given."""

from dataclasses import asdict, dataclass
from time import perf_counter
from typing import Any

import numpy as np

from data.scans import ScanFolder
from data.scene_graph import SceneGraph
from data.trajectory import Trajectory
from evaluation.map_metrics import room_scores, wall_scores
from evaluation.sequences import Sequence
from evaluation.trajectory import drift_reduction, error_in_bim
from evaluation.true_matches import true_matches
from matching import Hypothesis, MatchResult
from sgslam.config import AnchorSettings, Config
from sgslam.result import Result
from sgslam.slam import SceneGraphSlam

ARMS = {
    "odometry": "the odometry alone, its first pose set to the truth",
    "graph": "the S-graph without anchors, its first pose set to the truth",
    "planes": "plane anchors only",
    "rooms": "room anchors only",
    "anchored": "plane and room anchors",
    "oracle": "plane and room anchors, the true matches given",
}


@dataclass(frozen=True)
class Row:
    """One run. Errors in the BIM frame without alignment, over all scans; None where there is nothing to measure.

    `drift_reduction` is against the same graph without anchors. Walls and rooms: of the S-graph against the storey's
    A-graph under the true motion, those of the storey that were never seen included in the recall.
    """

    sequence: str
    seed: int
    arm: str
    anchored: bool
    rmse_bim_m: float | None
    max_bim_m: float | None
    yaw_rmse_deg: float | None
    drift_reduction: float | None
    matched_poses: int
    total_poses: int
    first_anchor_s: float | None
    wall_precision: float | None
    wall_offset_mm: float | None
    room_precision: float | None
    room_centroid_m: float | None
    seconds: float
    reason: str


class OracleMatcher:
    """Answers with the true matches, from the true T_bim_map (4, 4)."""

    def __init__(self, T_bim_map: np.ndarray[Any, Any], floor: str | None) -> None:
        self._T, self._floor = T_bim_map, floor

    def match(self, s: SceneGraph, a: SceneGraph) -> MatchResult:
        """As any matcher."""
        truth = true_matches(s, a.on_floor(self._floor), self._T)
        if len(truth.wall_surfaces) < 4:
            return MatchResult("none", "fewer than four true matches so far")
        rooms = tuple((s_id, a_id, 1.0) for s_id, a_id in truth.rooms.items())
        walls = tuple((s_id, a_id, 1.0) for s_id, a_id in truth.wall_surfaces.items())
        sole = Hypothesis(0.0, truth.T_a_s, self._floor, tuple(truth.rooms.items()))
        return MatchResult("unique", "the truth was given", rooms, walls, truth.T_a_s, self._floor, (sole,))


def run_arm(arm: str, sequence: Sequence, graph_rmse: float | None) -> Row:
    """Runs one arm; `graph_rmse` is the arm `graph`'s, for the drift reduction, where it is known already."""
    began = perf_counter()
    T_bim_map = sequence.truth.poses[0]
    floor = storey_of(sequence.a_graph, T_bim_map)
    config = Config(anchors=AnchorSettings(planes=arm != "rooms", rooms=arm != "planes"))
    bim = None if arm in ("odometry", "graph") else sequence.a_graph
    slam = SceneGraphSlam(bim, OracleMatcher(T_bim_map, floor) if arm == "oracle" else None, config)
    for scan in ScanFolder(sequence.scan_dir):
        slam.add_scan(scan.stamp_ns, scan.points)
    result = slam.finish()
    estimate = _estimate(arm, result, T_bim_map)
    error = None if estimate is None else error_in_bim(estimate, sequence.truth)
    walls = wall_scores(result.s_graph, sequence.a_graph.on_floor(floor), T_bim_map)
    rooms = room_scores(result.s_graph, sequence.a_graph.on_floor(floor), T_bim_map)
    rmse = None if error is None else error.position.rmse
    return Row(
        sequence.name, sequence.seed, arm, result.anchored, rmse,
        None if error is None else error.position.max,
        None if error is None else float(np.degrees(error.yaw.rmse)),
        drift_reduction(rmse, graph_rmse) if rmse is not None and graph_rmse is not None else None,
        0 if error is None else error.matched_poses, len(result.trajectory), result.first_anchor_s,
        walls.score.precision, None if walls.offset_mm is None else walls.offset_mm.median,
        rooms.score.precision, None if rooms.centroid is None else rooms.centroid.median,
        perf_counter() - began, result.reason,
    )  # fmt: skip


def storey_of(a_graph: SceneGraph, T_bim_sensor: np.ndarray[Any, Any]) -> str | None:
    """The storey whose floor lies next below a sensor pose (4, 4)."""
    below = [f for f in a_graph.floors if f.elevation is not None and f.elevation <= T_bim_sensor[2, 3]]
    return max(below, key=lambda f: f.elevation or 0.0).id if below else None


def _estimate(arm: str, result: Result, T_bim_first: np.ndarray[Any, Any]) -> Trajectory | None:
    """The arm's trajectory in the BIM frame; None where an arm with anchors was not anchored."""
    if arm in ("odometry", "graph"):
        own = result.trajectory_odometry if arm == "odometry" else result.trajectory_map
        return own.transformed(T_bim_first @ np.linalg.inv(own.poses[0]))
    return result.trajectory if result.anchored else None


def as_record(row: Row) -> dict[str, Any]:
    """A CSV line's values by column; empty for None."""
    return {name: "" if value is None else value for name, value in asdict(row).items()}


