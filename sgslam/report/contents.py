"""The data of the report and the plan picture, and the placement of the map in the plan."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.scene_graph import Floor, Room, SceneGraph, WallSurface
from data.trajectory import Trajectory
from sgslam.geometry.frames import se2_to_se3
from sgslam.session.soundness.scan_uncertainty import ScanUncertainty

Array = NDArray[np.float64]
DRAWN_HYPOTHESES = 4
BESIDE_GAP_M = 3.0  # gap between the plan and a map of unknown place


@dataclass(frozen=True)
class ReportData:
    """The data of the report and the plan picture, in the forms that the run writes.

    `s_graph` and both trajectories are in the map frame (the odometry in its own, with the same origin),
    `a_graph` and `truth` in the BIM frame. `matches`, `metrics` and `deviations` have the forms of matches.json,
    metrics.json and deviations.json. `scans` tells of the scans of `trajectory_map`; where it is None, all are known.
    `anchors` is the log of all anchors, as in a run's result. `placed` is False for a floor of the map that was not
    placed in the plan. `elements` are the entries of elements.json, its
    unplanned walls in the same form; `tolerance` (m) is that of their verdicts.
    """

    a_graph: SceneGraph | None
    s_graph: SceneGraph
    trajectory_map: Trajectory
    trajectory_odometry: Trajectory
    truth: Trajectory | None
    T_bim_map: Array | None
    matches: Mapping[str, Any] | None
    metrics: dict[str, Any]
    deviations: Sequence[Mapping[str, Any]]
    scans: ScanUncertainty | None = None
    anchors: Sequence[Mapping[str, Any]] = ()
    placed: bool = True
    elements: Sequence[Mapping[str, Any]] = ()
    tolerance: float = 0.0

    @property
    def known(self) -> Trajectory:
        """`trajectory_map` without the scans that were lost, or are in parts that were not placed."""
        return self.trajectory_map if self.scans is None else self.trajectory_map.only(self.scans.known)

    @property
    def hypotheses(self) -> list[dict[str, Any]]:
        """The matcher's hypotheses, the best first."""
        return list((self.matches or {}).get("hypotheses") or ())

    def pairs(self, kind: str) -> dict[str, tuple[str, float]]:
        """S id to (A id, confidence); `kind` is `rooms` or `wall_surfaces`."""
        return {s: (a, confidence) for s, a, confidence in (self.matches or {}).get(kind) or ()}


def split_by_floor(data: ReportData) -> list[ReportData]:
    """The data of each floor of the map, with the parts of the trajectories on it; unchanged if there is only one.

    The way between two floors belongs to the one that was left.
    """
    floors = data.s_graph.floors
    if len(floors) < 2:
        return [data]
    of = {k.stamp_ns: k.floor for k in data.s_graph.keyframes}
    stamps, on = np.array(sorted(of), dtype=np.int64), [floors[0].id]
    for stamp in stamps.tolist():
        on.append(of[stamp] or on[-1])
    return [_on_floor(data, floor, stamps, np.array(on[1:])) for floor in floors]


def _on_floor(data: ReportData, floor: Floor, stamps: NDArray[np.int64], on: NDArray[np.str_]) -> ReportData:
    """The data of a floor, given the keyframes' `stamps` (K,) and the ids of their floors `on` (K,)."""

    def there(trajectory: Trajectory) -> NDArray[np.bool_]:
        before = np.maximum(np.searchsorted(stamps, trajectory.stamps_ns, side="right") - 1, 0)
        return on[before] == floor.id

    matches = data.matches or {}
    storeys, ours = matches.get("floors"), there(data.trajectory_map)
    storey = (storeys or {}).get(floor.id, matches.get("floor"))
    return replace(
        data,
        s_graph=data.s_graph.on_floor(floor.id),
        matches={**matches, "floor": storey} if matches else None,
        trajectory_map=data.trajectory_map.only(ours),
        scans=None if data.scans is None else data.scans.only(ours),
        trajectory_odometry=data.trajectory_odometry.only(there(data.trajectory_odometry)),
        truth=None if data.truth is None else data.truth.only(there(data.truth)),
        placed=storeys is None or floor.id in storeys,
    )


def current_storey(data: ReportData) -> Floor | None:
    """The BIM's storey of the match, else of the best hypothesis, else the one with the most rooms; None where the BIM
    has no storeys, or the floor was not placed."""
    if data.a_graph is None or not data.a_graph.floors or not data.placed:
        return None
    by_id = {floor.id: floor for floor in data.a_graph.floors}
    for floor_id in ((data.matches or {}).get("floor"), *(h.get("floor") for h in data.hypotheses)):
        if floor_id in by_id:
            return by_id[floor_id]
    rooms = data.a_graph.rooms
    return max(by_id.values(), key=lambda f: sum(r.floor == f.id for r in rooms))


def placement(data: ReportData, floor: Floor | None) -> tuple[Array, str]:
    """T_plan_map (4, 4), in plan view, and the plan's heading, which states how reliable it is.

    The plan's frame is the BIM frame where there is a BIM, else the map frame.
    """
    if data.a_graph is None:
        return np.eye(4), "The map (no plan was given)"
    candidates = [(data.matches or {}).get("T_a_s"), *(h.get("T_a_s") for h in data.hypotheses)]
    best = next((g for g in candidates if g is not None), None)
    if data.T_bim_map is not None:
        T_plan_map, remark = data.T_bim_map, ""
    elif best is not None:
        T_plan_map = se2_to_se3(*best)
        remark = "; the map is placed by the best hypothesis, which was not accepted"
    else:
        T_plan_map = _pose_beside_plan(data, floor)
        remark = "; the map is drawn beside it, as its place is unknown"
    if not data.placed:
        return T_plan_map, f"{data.s_graph.floors[0].id} of the map: not placed in the plan"
    return T_plan_map, ((floor.name or floor.id) if floor else "The plan") + remark


def _pose_beside_plan(data: ReportData, floor: Floor | None) -> Array:
    assert data.a_graph is not None
    items: list[WallSurface | Room] = [*data.a_graph.wall_surfaces, *data.a_graph.rooms]
    plan = [item.centroid for item in items if floor is None or item.floor == floor.id]
    ours: list[Any] = [w.centroid for w in data.s_graph.wall_surfaces]
    ours += list(data.trajectory_map.positions[:, :2])
    if not plan or not ours:
        return np.eye(4)
    x = float(np.max(plan, axis=0)[0] - np.min(ours, axis=0)[0]) + BESIDE_GAP_M
    y = float(np.mean(plan, axis=0)[1] - np.mean(ours, axis=0)[1])
    return se2_to_se3(0.0, x, y)
