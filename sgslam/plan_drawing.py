"""What the plan from above shows, as plain geometry in one frame; drawn by `plan_view` (PNG) and `plan_svg`.

The plan's frame is the BIM frame where there is a BIM, else the map frame. `xy` arrays are metres.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from data.scene_graph import Floor, Room, SceneGraph, WallSurface
from data.trajectory import Trajectory

Array = NDArray[np.float64]
MAX_VERTICES = 3000  # of a drawn path: more than a screen resolves
STUB_M = 0.4  # drawn length of a wall surface whose length is not known
LARGEST_TEXT_M, SMALLEST_TEXT_M = 0.42, 0.12
GLYPH_WIDTH = 0.6  # of a letter, relative to the text's size
BESIDE_M = 3.0  # gap between the plan and a map that nothing places in it

LABELS = {
    "bim-walls": "wall of the BIM",
    "walls-matched": "mapped wall, matched",
    "walls-unmatched": "mapped wall, not matched",
    "matches": "match, from mapped to planned wall",
    "rooms-matched": "matched room of the BIM",
    "map-rooms": "room of the map",
    "odometry": "before anchoring (odometry)",
    "trajectory": "after anchoring (final)",
    "truth": "ground truth",
}
NOT_ANCHORED = {"odometry": "odometry", "trajectory": "trajectory, not anchored"}

PathKind = Literal["odometry", "truth", "trajectory"]


@dataclass(frozen=True)
class ReportData:
    """All that the report and the plan are made of; every part in the form that the run writes it.

    `s_graph` and both trajectories are in the map frame (odometry: its own, which starts where the map does),
    `a_graph` and `truth` in the BIM frame. `matches` and `metrics` have the forms of matches.json and
    metrics.json.
    """

    a_graph: SceneGraph | None
    s_graph: SceneGraph
    trajectory_map: Trajectory
    trajectory_odometry: Trajectory
    truth: Trajectory | None
    T_bim_map: Array | None
    matches: dict[str, Any] | None
    metrics: dict[str, Any]


@dataclass(frozen=True)
class DrawnWall:
    """`ends` is (2, 2); `title` names it when pointed at."""

    ends: Array
    matched: bool
    title: str


@dataclass(frozen=True)
class DrawnRoom:
    """`outline` is (K, 2), not closed, or None; `label` is where the name stands."""

    outline: Array | None
    label: Array
    name: str
    matched: bool
    title: str

    def text_size(self) -> float:
        """Metres: the height of letters with which the name fits the room's width."""
        if self.outline is None:
            return 0.7 * LARGEST_TEXT_M
        fits = 0.9 * np.ptp(self.outline[:, 0]) / (GLYPH_WIDTH * max(len(self.name), 3))
        return float(np.clip(fits, SMALLEST_TEXT_M, LARGEST_TEXT_M))


@dataclass(frozen=True)
class PlanDrawing:
    """One storey from above.

    `match_lines` is (M, 2, 2): from each matched S surface's mid point to its A surface's. `labels` names the
    layers: what the legends say.
    """

    heading: str
    bim_walls: tuple[DrawnWall, ...]
    bim_rooms: tuple[DrawnRoom, ...]
    map_walls: tuple[DrawnWall, ...]
    map_rooms: tuple[DrawnRoom, ...]
    match_lines: Array
    paths: dict[PathKind, Array]
    labels: dict[str, str]

    def bounds(self) -> tuple[Array, Array]:
        """The lower left and upper right corners (2,) of all that is drawn."""
        parts = [w.ends for w in (*self.bim_walls, *self.map_walls)]
        for room in (*self.bim_rooms, *self.map_rooms):
            parts.append(room.label[None] if room.outline is None else room.outline)
        points = np.vstack([*parts, *self.paths.values(), np.empty((0, 2))])
        if not len(points):
            return np.array([-1.0, -1.0]), np.array([1.0, 1.0])
        return points.min(axis=0), points.max(axis=0)


def plan_drawing(data: ReportData) -> PlanDrawing:
    """Chooses the storey, places the map in the plan, and turns all of it into lines and outlines."""
    floor = robots_floor(data)
    walls_a = [w for w in data.a_graph.wall_surfaces if _on(w, floor)] if data.a_graph else []
    rooms_a = [r for r in data.a_graph.rooms if _on(r, floor)] if data.a_graph else []
    T_plan_map, heading = _placement(data, floor, walls_a, rooms_a)
    matched_walls, matched_rooms = _pairs(data, "wall_surfaces"), _pairs(data, "rooms")
    names = {r.id: r.name or r.id for r in (*rooms_a, *data.s_graph.rooms)}
    labels = {r.id: np.array(r.centroid) for r in rooms_a}
    taken_a = {a for a, _ in matched_rooms.values()}
    identity = np.eye(4)
    return PlanDrawing(
        heading,
        tuple(_wall(w, identity, False, f"{w.id} {w.source}".strip()) for w in walls_a),
        tuple(_room(r, identity, r.id in taken_a, names[r.id]) for r in rooms_a),
        tuple(_wall(w, T_plan_map, w.id in matched_walls, _pair_title(w.id, matched_walls)) for w in
              data.s_graph.wall_surfaces),
        tuple(_room(r, T_plan_map, r.id in matched_rooms, _pair_title(r.id, matched_rooms, names),
                    labels.get(matched_rooms.get(r.id, ("", 0.0))[0])) for r in data.s_graph.rooms),
        _match_lines(data, T_plan_map, matched_walls, {w.id for w in walls_a}),
        _paths(data, T_plan_map),
        LABELS if data.T_bim_map is not None else LABELS | NOT_ANCHORED,
    )  # fmt: skip


def robots_floor(data: ReportData) -> Floor | None:
    """The BIM's storey that the robot drives on; None where the BIM has none.

    The match names it; else the height of the anchored trajectory, or of the true one; else it is the storey
    with the most rooms.
    """
    floors = data.a_graph.floors if data.a_graph else ()
    if not floors or data.a_graph is None:
        return None
    matches = data.matches or {}
    named = [matches.get("floor"), *(h.get("floor") for h in matches.get("hypotheses") or ())]
    for floor_id in named:
        if found := [f for f in floors if f.id == floor_id]:
            return found[0]
    known = sorted((f.elevation, i) for i, f in enumerate(floors) if f.elevation is not None)
    in_bim = data.truth
    if data.T_bim_map is not None:
        in_bim = data.trajectory_map.transformed(data.T_bim_map)
    if in_bim is not None and known and len(in_bim):
        height = float(np.median(in_bim.positions[:, 2]))
        below = [i for elevation, i in known if elevation <= height]
        return floors[below[-1] if below else known[0][1]]
    rooms = data.a_graph.rooms
    return max(floors, key=lambda f: sum(r.floor == f.id for r in rooms))


def _on(item: WallSurface | Room, floor: Floor | None) -> bool:
    return floor is None or item.floor == floor.id


def _pairs(data: ReportData, kind: str) -> dict[str, tuple[str, float]]:
    """S id to (A id, confidence)."""
    return {s: (a, confidence) for s, a, confidence in (data.matches or {}).get(kind) or ()}


def _pair_title(s_id: str, pairs: dict[str, tuple[str, float]], names: dict[str, str] | None = None) -> str:
    shown = names or {}
    if s_id not in pairs:
        return f"{shown.get(s_id, s_id)}: not matched"
    a_id, confidence = pairs[s_id]
    return f"{shown.get(s_id, s_id)} is {shown.get(a_id, a_id)} ({confidence:.2f})"


def _placement(
    data: ReportData, floor: Floor | None, walls_a: list[WallSurface], rooms_a: list[Room]
) -> tuple[Array, str]:
    """T_plan_map (4, 4), and the plan's heading, which says how sure it is."""
    if data.a_graph is None:
        return np.eye(4), "The map (no BIM was given)"
    storey = (floor.name or floor.id) if floor else "The plan"
    if data.T_bim_map is not None:
        return data.T_bim_map, storey
    matches = data.matches or {}
    guesses = [matches.get("T_a_s"), *(h.get("T_a_s") for h in matches.get("hypotheses") or ())]
    guess = next((g for g in guesses if g is not None), None)
    T = np.eye(4)
    if guess is not None:
        yaw, x, y = guess
        T[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
        T[:2, 3] = x, y
        return T, f"{storey}; the map is placed by the best guess, which was not committed to"
    plan = [np.array(w.centroid) for w in walls_a] + [np.array(r.centroid) for r in rooms_a]
    ours = [np.array(w.centroid) for w in data.s_graph.wall_surfaces]
    ours += list(data.trajectory_map.positions[:, :2])
    if plan and ours:
        T[0, 3] = np.max(plan, axis=0)[0] - np.min(ours, axis=0)[0] + BESIDE_M
        T[1, 3] = np.mean(plan, axis=0)[1] - np.mean(ours, axis=0)[1]
    return T, f"{storey}; the map lies beside it, its place is not known"


def _placed(points: Array, T: Array) -> Array:
    return points @ T[:3, :3].T + T[:3, 3]


def _placed_xy(points: Any, T: Array) -> Array:
    xy = np.asarray(points, dtype=float).reshape(-1, 2)
    return xy @ T[:2, :2].T + T[:2, 3]


def _wall(wall: WallSurface, T_plan: Array, matched: bool, title: str) -> DrawnWall:
    centre, (nx, ny) = np.array(wall.centroid), wall.normal
    half = np.array([-ny, nx]) * (wall.length or STUB_M) / 2
    return DrawnWall(_placed_xy([centre + half, centre - half], T_plan), matched, title)


def _room(room: Room, T_plan: Array, matched: bool, title: str, label: Array | None = None) -> DrawnRoom:
    outline = _placed_xy(room.polygon, T_plan) if room.polygon else None
    label = _placed_xy(room.centroid, T_plan)[0] if label is None else label
    return DrawnRoom(outline, label, room.name or room.id, matched, title)


def _match_lines(
    data: ReportData, T_plan_map: Array, pairs: dict[str, tuple[str, float]], shown_a: set[str]
) -> Array:
    lines = []
    for s_id, (a_id, _) in pairs.items():
        if data.a_graph and s_id in data.s_graph.surface_by_id and a_id in shown_a:
            ours = _placed_xy(data.s_graph.surface_by_id[s_id].centroid, T_plan_map)[0]
            lines.append([ours, np.array(data.a_graph.surface_by_id[a_id].centroid)])
    return np.array(lines).reshape(-1, 2, 2)


def _paths(data: ReportData, T_plan_map: Array) -> dict[PathKind, Array]:
    paths: dict[PathKind, Array] = {}
    if len(data.trajectory_odometry) and len(data.trajectory_map):
        # its first pose on the map's: what the odometry alone would have said of the way from there
        T_map_odom = data.trajectory_map.poses[0] @ np.linalg.inv(data.trajectory_odometry.poses[0])
        paths["odometry"] = _path(data.trajectory_odometry, T_plan_map @ T_map_odom)
    if data.truth is not None and data.a_graph is not None:
        paths["truth"] = _path(data.truth, np.eye(4))
    paths["trajectory"] = _path(data.trajectory_map, T_plan_map)
    return {kind: path for kind, path in paths.items() if len(path)}


def _path(trajectory: Trajectory, T_plan: Array) -> Array:
    if not len(trajectory):
        return np.empty((0, 2))
    chosen = np.unique(np.linspace(0, len(trajectory) - 1, MAX_VERTICES).astype(int))
    return _placed(trajectory.positions[chosen], T_plan)[:, :2]
