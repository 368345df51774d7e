"""The contents of the plan and the 3D view as plain geometry in one frame.

Drawn by `plan_png`, `plan_svg` and `scene_3d`. The plan's frame is the BIM frame where there is a BIM, else
the map frame; metres.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.scene_graph import Floor, Room, SceneGraph, WallSurface
from sgslam.as_built.deviation_bands import band_of, deviation_text
from sgslam.geometry.frames import transform_points
from sgslam.report.contents import ReportData, current_storey, placement
from sgslam.report.drawn_paths import DrawnPath, PathKind, drawn_paths, subsample, uncertainty_band
from sgslam.report.elements import DrawnElement, drawn_elements, element_name, slug

Array = NDArray[np.float64]
MAX_KEYFRAMES = 1000
STUB_M = 0.4  # drawn length of a wall surface whose length is not known
STOREY_M, SENSOR_M = 2.5, 1.0  # drawn height of a wall, and of the sensor above the floor, where not known
LARGEST_TEXT_M, SMALLEST_TEXT_M = 0.42, 0.12
GLYPH_WIDTH = 0.6  # of a letter, relative to the text's size
STRAY = 0.3  # of the building's longer side, by which paths at unknown places may widen the view

LABELS = {
    "bim-walls": "wall of the BIM",
    "elements": "planned element, by its verdict",
    "walls-matched": "mapped wall, matched",
    "walls-unmatched": "mapped wall, not matched",
    "anchors-withdrawn": "planned wall whose anchor was withdrawn",
    "matches": "match, from mapped to planned wall",
    "rooms-matched": "matched room of the BIM",
    "map-rooms": "room of the map",
    "odometry": "before anchoring (odometry)",
    "trajectory": "after anchoring (final)",
    "uncertainty": "uncertainty of the position (95 %, to scale)",
    "lost": "lost",
    "truth": "ground truth",
}
NOT_ANCHORED = {
    "walls-matched": "mapped wall, matched in the best hypothesis",
    "rooms-matched": "room of the BIM in the best hypothesis",
    "odometry": "odometry",
    "trajectory": "trajectory, not anchored",
}
WITHOUT_PLAN = {"walls-unmatched": "mapped wall", "odometry": "odometry", "trajectory": "trajectory"}


@dataclass(frozen=True)
class DrawnWall:
    """`ends` (2, 2) in plan, the first on the left when looking along the normal; `z` of its lower and upper edge.

    `title` is the tooltip; `band` the class of its deviation from the plan (see `deviation_bands`), None where unknown.
    """

    id: str
    ends: Array
    z: tuple[float, float]
    matched: bool
    title: str
    band: str | None = None
    significant: bool = False


@dataclass(frozen=True)
class DrawnRoom:
    """`outline` is (K, 2), not closed, or None; `label` is the position of its name."""

    outline: Array | None
    label: Array
    name: str
    matched: bool
    title: str

    def text_size(self) -> float:
        """The text height (m) at which the name fits the room's width."""
        if self.outline is None:
            return 0.7 * LARGEST_TEXT_M
        fits = 0.9 * np.ptp(self.outline[:, 0]) / (GLYPH_WIDTH * max(len(self.name), 3))
        return float(np.clip(fits, SMALLEST_TEXT_M, LARGEST_TEXT_M))


@dataclass(frozen=True)
class Mark:
    """A line through `points` (N, 2), in the plan's frame, or (`closed`) the area within them. `title` is the tooltip,
    `looks` are the style classes within its layer, `refers` the name and value of what tables refer to it by."""

    points: Array
    title: str = ""
    closed: bool = False
    looks: tuple[str, ...] = ()
    refers: tuple[str, str] | None = None


Layers = list[tuple[str, list[Mark]]]  # by name, from bottom to top


@dataclass(frozen=True)
class PlanDrawing:
    """One storey.

    `match_lines` is (M, 2, 2): from each matched S surface's mid point to its A surface's. `keyframes` is (K, 3),
    `floor_z` the floor's height. `labels` names the layers in the legends. `T_plan_map` (4, 4) places the map in the
    plan. `withdrawn` are the planned walls whose anchors were withdrawn. `band` holds the outlines (K, 2) of the
    trajectory's uncertainty. `elements` are the planned elements with a verdict.
    """

    heading: str
    bim_walls: tuple[DrawnWall, ...]
    bim_rooms: tuple[DrawnRoom, ...]
    map_walls: tuple[DrawnWall, ...] = ()
    map_rooms: tuple[DrawnRoom, ...] = ()
    match_lines: Array = field(default_factory=lambda: np.empty((0, 2, 2)))
    paths: dict[PathKind, list[DrawnPath]] = field(default_factory=dict)
    keyframes: Array = field(default_factory=lambda: np.empty((0, 3)))
    floor_z: float = 0.0
    labels: dict[str, str] = field(default_factory=dict)
    T_plan_map: Array = field(default_factory=lambda: np.eye(4))
    withdrawn: tuple[DrawnWall, ...] = ()
    band: Sequence[Array] = ()
    elements: tuple[DrawnElement, ...] = ()

    def bounds(self) -> tuple[Array, Array]:
        """The lower left and upper right corners (2,) of the view; paths that stray far away are cut off: the
        odometry, and what was not placed."""
        parts = [w.ends for w in (*self.bim_walls, *self.map_walls)]
        for room in (*self.bim_rooms, *self.map_rooms):
            parts.append(room.label[None] if room.outline is None else room.outline)
        sure, unsure = self._places("trajectory", "truth"), self._places("odometry", "lost")
        points = np.vstack([*parts, sure]) if len(parts) or len(sure) else unsure
        if not len(points):
            return np.array([-1.0, -1.0]), np.array([1.0, 1.0])
        low, high = points.min(axis=0), points.max(axis=0)
        stray = max(STRAY * float((high - low).max()), 1.0)
        strayed = np.vstack([points, np.clip(unsure, low - stray, high + stray)])
        return strayed.min(axis=0), strayed.max(axis=0)

    def _places(self, *kinds: PathKind) -> Array:
        """(N, 2) all vertices of paths."""
        pieces = [path.points[:, :2] for kind in kinds for path in self.paths.get(kind, ())]
        return np.vstack([np.empty((0, 2)), *pieces])

    def centre(self) -> Array:
        """(2,) the centre in whole metres, the origin of drawings."""
        low, high = self.bounds()
        return np.round((low + high) / 2)

    def layers(self) -> Layers:
        """All that is drawn but the names of rooms and the trajectory's uncertainty."""
        lines = {kind: [Mark(path.points[:, :2], path.title) for path in own] for kind, own in self.paths.items()}
        if way := lines.get("trajectory"):  # lines of no length: dots
            places = (("start", way[0].points[0]), ("end", way[-1].points[-1]))
            way += [Mark(np.stack([place, place]), name, looks=(name,)) for name, place in places]
        elements = [
            Mark(e.outline, e.title, True, (f"verdict-{slug(e.verdict)}", *["flat"] * e.flat), ("element", e.global_id))
            for e in sorted(self.elements, key=lambda e: not e.flat)
        ]
        return [
            ("rooms-matched", _outlines(r for r in self.bim_rooms if r.matched)),
            ("map-rooms", _outlines(self.map_rooms)),
            ("bim-walls", [Mark(w.ends, w.title) for w in self.bim_walls]),
            ("elements", elements),
            ("anchors-withdrawn", [Mark(w.ends, w.title) for w in self.withdrawn]),
            ("walls-unmatched", _mapped(w for w in self.map_walls if not w.matched)),
            ("walls-matched", _mapped(w for w in self.map_walls if w.matched)),
            ("matches", [Mark(line) for line in self.match_lines]),
            *((kind, lines.get(kind, [])) for kind in ("odometry", "trajectory", "lost", "truth")),
        ]

    @property
    def with_deviations(self) -> bool:
        """Whether any mapped wall has a known deviation from the plan."""
        return any(w.band for w in self.map_walls)


def _outlines(rooms: Iterable[DrawnRoom]) -> list[Mark]:
    return [Mark(r.outline, r.title, True) for r in rooms if r.outline is not None]


def _mapped(walls: Iterable[DrawnWall]) -> list[Mark]:
    """Significant ones last, on top."""
    return [
        Mark(w.ends, w.title, False, (*([f"band-{w.band}"] if w.band else []), *["significant"] * w.significant),
             ("wall", w.id))
        for w in sorted(walls, key=lambda w: w.significant)
    ]  # fmt: skip


def plan_drawing(data: ReportData) -> PlanDrawing:
    """Selects the storey, places the map in the plan and converts both to lines and outlines."""
    floor = current_storey(data)
    T_plan_map, heading = placement(data, floor)
    if not data.placed:
        data = replace(data, a_graph=SceneGraph("bim"))  # it lies on none of the plan's storeys
    floor_z = _floor_z(data, floor, T_plan_map)
    rooms_a = [r for r in (data.a_graph.rooms if data.a_graph else ()) if _on(r, floor)]
    matched_rooms = data.pairs("rooms")
    names = {r.id: r.name or r.id for r in (*rooms_a, *data.s_graph.rooms)}
    labels = {r.id: np.array(r.centroid) for r in rooms_a}
    taken_a = {a for a, _ in matched_rooms.values()}
    bim_walls = planned_walls(data, floor, floor_z)
    return PlanDrawing(
        heading,
        bim_walls,
        tuple(planned_room(r, r.id in taken_a) for r in rooms_a),
        mapped_walls(data, T_plan_map, floor_z),
        tuple(_room(r, T_plan_map, r.id in matched_rooms, _pair_title(data, r.id, matched_rooms, names),
                    labels.get(matched_rooms.get(r.id, ("", 0.0))[0])) for r in data.s_graph.rooms),
        _match_lines(data, T_plan_map, {w.id for w in bim_walls}),
        drawn_paths(data, T_plan_map),
        _keyframes(data, T_plan_map),
        floor_z,
        _labels(data),
        T_plan_map,
        _withdrawn(data, bim_walls),
        uncertainty_band(data, T_plan_map),
        drawn_elements(data.elements, floor) if data.placed else (),
    )  # fmt: skip


def _labels(data: ReportData) -> dict[str, str]:
    if data.T_bim_map is not None:
        return LABELS
    return LABELS | (WITHOUT_PLAN if data.a_graph is None else NOT_ANCHORED)


def planned_wall(wall: WallSurface) -> DrawnWall:
    """A wall surface of the BIM, in the BIM frame."""
    return _wall(wall, np.eye(4), 0.0, False, f"{wall.id} {wall.source}")


def planned_room(room: Room, matched: bool = False) -> DrawnRoom:
    """A room of the BIM, in the BIM frame."""
    return _room(room, np.eye(4), matched, room.name or room.id)


def planned_walls(data: ReportData, floor: Floor | None, floor_z: float) -> tuple[DrawnWall, ...]:
    """The BIM's wall surfaces on a storey (all where it is None), in the BIM frame."""
    walls = [w for w in (data.a_graph.wall_surfaces if data.a_graph else ()) if _on(w, floor)]
    absent = {d["a_id"] for d in data.deviations if d["kind"] == "absent"}
    names = {entry["global_id"]: element_name(entry) for entry in data.elements}
    return tuple(
        _wall(
            w, np.eye(4), floor_z, False,
            f"{w.id} {names.get(w.source, w.source)}{': not found' if w.id in absent else ''}",
        )
        for w in walls
    )  # fmt: skip


def mapped_walls(data: ReportData, T_plan_map: Array, floor_z: float) -> tuple[DrawnWall, ...]:
    """The map's wall surfaces (whose heights are over their floor), placed in the plan, with their deviations."""
    pairs = data.pairs("wall_surfaces")
    ranked = sorted(data.deviations, key=lambda d: (bool(d["significant"]), abs(d["offset_m"] or 0.0)))
    found = {d["s_id"]: d for d in ranked if d["s_id"] is not None}  # the largest one of walls in one plane
    drawn = []
    for w in data.s_graph.wall_surfaces:
        title, deviation = _pair_title(data, w.id, pairs), found.get(w.id)
        if deviation is None:
            drawn.append(_wall(w, T_plan_map, floor_z, w.id in pairs, title, above=floor_z))
            continue
        title += f"\n{deviation_text(deviation)}"
        band, significant = band_of(deviation["offset_m"]), bool(deviation["significant"])
        drawn.append(_wall(w, T_plan_map, floor_z, w.id in pairs, title, band, significant, floor_z))
    return tuple(drawn)


def _floor_z(data: ReportData, floor: Floor | None, T_plan_map: Array) -> float:
    """The storey's elevation, else the mapped floor's, else a typical sensor height below the trajectory."""
    if floor is not None and floor.elevation is not None:
        return floor.elevation
    mapped = [f.elevation for f in data.s_graph.floors if f.elevation is not None]
    if mapped:
        return float(T_plan_map[2, 3] + mapped[0])
    heights = _placed(data.trajectory_map.positions, T_plan_map)[:, 2]
    return float(np.median(heights)) - SENSOR_M if len(heights) else 0.0


def _on(item: WallSurface | Room, floor: Floor | None) -> bool:
    return floor is None or item.floor == floor.id


def _pair_title(
    data: ReportData, s_id: str, pairs: dict[str, tuple[str, float]], names: dict[str, str] | None = None
) -> str:
    shown = names or {}
    if s_id not in pairs:
        return f"{shown.get(s_id, s_id)}{'' if data.a_graph is None else ': not matched'}"
    a_id, confidence = pairs[s_id]
    return f"{shown.get(s_id, s_id)} is {shown.get(a_id, a_id)} ({confidence:.2f})"


def _placed(points: Any, T: Array) -> Array:
    return transform_points(T, np.asarray(points, dtype=float).reshape(-1, 3))


def _placed_xy(points: Any, T: Array) -> Array:
    xy = np.asarray(points, dtype=float).reshape(-1, 2)
    return xy @ T[:2, :2].T + T[:2, 3]


def _wall(
    wall: WallSurface, T_plan: Array, floor_z: float, matched: bool, title: str, band: str | None = None,
    significant: bool = False, above: float = 0.0,
) -> DrawnWall:  # fmt: skip
    centre, (nx, ny) = np.array(wall.centroid), wall.normal
    half = np.array([-ny, nx]) * (wall.length or STUB_M) / 2
    z = (floor_z, floor_z + STOREY_M)
    if wall.height is not None:
        z = wall.height[0] + above, wall.height[1] + above
    ends = _placed_xy([centre + half, centre - half], T_plan)
    return DrawnWall(wall.id, ends, z, matched, title.strip(), band, significant)


def _room(room: Room, T_plan: Array, matched: bool, title: str, label: Array | None = None) -> DrawnRoom:
    outline = _placed_xy(room.polygon, T_plan) if room.polygon else None
    label = _placed_xy(room.centroid, T_plan)[0] if label is None else label
    return DrawnRoom(outline, label, room.name or room.id, matched, title)


def _withdrawn(data: ReportData, bim_walls: Iterable[DrawnWall]) -> tuple[DrawnWall, ...]:
    """The planned walls that have no anchor any more, with the reason for which they lost the last one."""
    held = {anchor["a_id"] for anchor in data.anchors if anchor["state"] != "withdrawn"}
    events = sorted((anchor["events"][-1]["stamp_ns"], anchor["a_id"], anchor["events"][-1]["why"])
                    for anchor in data.anchors)  # fmt: skip
    why = {a_id: reason for _, a_id, reason in events if a_id not in held}
    return tuple(
        replace(wall, title=f"{wall.title}\nanchor withdrawn: {why[wall.id]}") for wall in bim_walls if wall.id in why
    )


def _match_lines(data: ReportData, T_plan_map: Array, shown_a: Iterable[str]) -> Array:
    lines = []
    for s_id, (a_id, _) in data.pairs("wall_surfaces").items():
        if data.a_graph and s_id in data.s_graph.surface_by_id and a_id in shown_a:
            ours = _placed_xy(data.s_graph.surface_by_id[s_id].centroid, T_plan_map)[0]
            lines.append([ours, np.array(data.a_graph.surface_by_id[a_id].centroid)])
    return np.array(lines).reshape(-1, 2, 2)


def _keyframes(data: ReportData, T_plan_map: Array) -> Array:
    positions = _placed([k.pose[:3] for k in data.s_graph.keyframes], T_plan_map)
    return positions[subsample(len(positions), MAX_KEYFRAMES)]
