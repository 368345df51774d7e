"""The contents of the plan as plain geometry in one frame, which `plan_png` and `plan_svg` draw.

The plan's frame is the BIM frame where there is a BIM, else the map frame; metres.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.scene_graph import Room, SceneGraph, WallSurface
from sgslam.as_built.deviation_bands import band_of, deviation_text
from sgslam.report.contents import ReportData, current_storey, placement
from sgslam.report.drawn_paths import Mark, drawn_paths, uncertainty_band
from sgslam.report.elements import element_marks, element_name

Array = NDArray[np.float64]
_TEXT_M = 0.42  # height of a name, at most
_STRAY = 0.3  # of the building's longer side, by which paths at unknown places may widen the view

LABELS = {
    "bim-walls": "wall of the BIM",
    "elements": "planned element, by its verdict",
    "walls-matched": "mapped wall, matched",
    "walls-unmatched": "mapped wall, not matched",
    "anchors-withdrawn": "planned wall whose anchor was withdrawn",
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
_UNSURE = ("odometry", "lost")  # layers that may stray, and are cut off then
_NOT_SHOWN_FOR = (*_UNSURE, "elements", "uncertainty")  # layers that do not widen the view


@dataclass(frozen=True)
class Name:
    """Text of a height `size` (m) in a layer, moved down from its `place` (2,) by `rise` times its size; `look` is its
    style class."""

    text: str
    place: Array
    size: float
    layer: str
    rise: float
    look: str = ""


@dataclass(frozen=True)
class PlanDrawing:
    """One storey.

    `layers` are from bottom to top, with `labels` for the legends; `names` are those of rooms.
    """

    heading: str
    layers: dict[str, list[Mark]]
    names: Sequence[Name] = ()
    labels: dict[str, str] = field(default_factory=dict)

    def bounds(self) -> tuple[Array, Array]:
        """The lower left and upper right corners (2,) of the view; paths that stray far away are cut off: the
        odometry, and what was not placed."""
        unsure = self._points(*_UNSURE)
        points = self._points(*(layer for layer in self.layers if layer not in _NOT_SHOWN_FOR))
        points = np.vstack([points, *(name.place for name in self.names)])
        if not len(points):
            points = unsure if len(unsure) else np.array([[-1.0, -1.0], [1.0, 1.0]])
        low, high = points.min(axis=0), points.max(axis=0)
        stray = max(_STRAY * float((high - low).max()), 1.0)
        strayed = np.vstack([points, np.clip(unsure, low - stray, high + stray)])
        return strayed.min(axis=0), strayed.max(axis=0)

    def _points(self, *layers: str) -> Array:
        """(N, 2) all vertices of layers."""
        marks = [mark.points for layer in layers for mark in self.layers.get(layer, ())]
        return np.vstack([np.empty((0, 2)), *marks])

    @property
    def with_deviations(self) -> bool:
        """Whether any mapped wall has a known deviation from the plan."""
        walls = [*self.layers["walls-matched"], *self.layers["walls-unmatched"]]
        return any(look.startswith("band-") for wall in walls for look in wall.looks)


def plan_drawing(data: ReportData) -> PlanDrawing:
    """Selects the storey, places the map in the plan and converts both to lines and outlines."""
    floor = current_storey(data)
    T_plan_map, heading = placement(data, floor)
    plan = SceneGraph("bim") if data.a_graph is None or not data.placed else data.a_graph  # else it is on no storey
    if floor is not None:
        plan = plan.on_floor(floor.id)
    pairs = data.pairs("rooms")
    taken = {a for a, _ in pairs.values()}
    planned = _planned_walls(data, plan)
    matched, unmatched = _mapped_walls(data, T_plan_map)
    room_names = {r.id: r.name or r.id for r in (*plan.rooms, *data.s_graph.rooms)}
    places = {r.id: np.array(r.centroid) for r in plan.rooms}
    names = [room_name(room, "bim-walls", -0.25) for room in plan.rooms]
    for room in data.s_graph.rooms:
        own = room_name(room, "map-rooms", 0.95 if room.id in pairs else 0.35, T_plan_map)
        names.append(replace(own, place=places.get(pairs[room.id][0], own.place)) if room.id in pairs else own)
    layers = {
        "rooms-matched": room_marks([r for r in plan.rooms if r.id in taken]),
        "map-rooms": [
            Mark(_placed_xy(r.polygon, T_plan_map), _pair_title(data, r.id, pairs, room_names), closed=True)
            for r in data.s_graph.rooms
            if r.polygon
        ],
        "uncertainty": uncertainty_band(data, T_plan_map),
        "bim-walls": list(planned.values()),
        "elements": element_marks(data.elements, floor) if data.placed else [],
        "anchors-withdrawn": _withdrawn(data, planned),
        "walls-unmatched": unmatched,
        "walls-matched": matched,
        **drawn_paths(data, T_plan_map),
    }
    labels = LABELS
    if data.T_bim_map is None:
        labels = LABELS | (WITHOUT_PLAN if data.a_graph is None else NOT_ANCHORED)
    return PlanDrawing(heading, layers, names, labels)


def wall_mark(wall: WallSurface, title: str) -> Mark:
    """A wall surface in the frame of its graph."""
    return Mark(np.array(wall.ends()), title.strip())


def room_marks(rooms: Sequence[Room]) -> list[Mark]:
    """The areas of the BIM's rooms whose outlines are known."""
    return [Mark(np.array(r.polygon, dtype=float), r.name or r.id, closed=True) for r in rooms if r.polygon]


def room_name(room: Room, layer: str, rise: float, T_plan: Array | None = None) -> Name:
    """The name of a room, as large as fits its width."""
    text, T = room.name or room.id, np.eye(4) if T_plan is None else T_plan
    size = 0.7 * _TEXT_M
    if room.polygon:
        width = float(np.ptp(_placed_xy(room.polygon, T)[:, 0]))
        size = min(1.5 * width / max(len(text), 3), _TEXT_M)  # a letter is 0.6 times as wide as high
    return Name(text, _placed_xy(room.centroid, T)[0], size, layer, rise)


def _planned_walls(data: ReportData, plan: SceneGraph) -> dict[str, Mark]:
    """The BIM's wall surfaces on the storey, by id."""
    absent = {d["a_id"] for d in data.deviations if d["kind"] == "absent"}
    names = {entry["global_id"]: element_name(entry) for entry in data.elements}
    return {
        w.id: wall_mark(w, f"{w.id} {names.get(w.source, w.source)}{': not found' if w.id in absent else ''}")
        for w in plan.wall_surfaces
    }


def _mapped_walls(data: ReportData, T_plan_map: Array) -> tuple[list[Mark], list[Mark]]:
    """The map's wall surfaces that are matched, and those that are not, placed in the plan, with their deviations;
    significant ones last, on top."""
    pairs = data.pairs("wall_surfaces")
    ranked = sorted(data.deviations, key=lambda d: (bool(d["significant"]), abs(d["offset_m"] or 0.0)))
    found = {d["s_id"]: d for d in ranked if d["s_id"] is not None}  # the largest one of walls in one plane
    matched, unmatched = list[Mark](), list[Mark]()
    for w in data.s_graph.wall_surfaces:
        title, looks, deviation = _pair_title(data, w.id, pairs), [], found.get(w.id)
        if deviation is not None:
            title += f"\n{deviation_text(deviation)}"
            band = band_of(deviation["offset_m"])
            looks = [*([f"band-{band}"] if band else []), *(["significant"] if deviation["significant"] else [])]
        source = "" if deviation is None else deviation["source"]
        mark = Mark(_placed_xy(w.ends(), T_plan_map), title, looks=tuple(looks), element=source)
        (matched if w.id in pairs else unmatched).append(mark)
    for marks in (matched, unmatched):
        marks.sort(key=lambda mark: "significant" in mark.looks)
    return matched, unmatched


def _pair_title(
    data: ReportData, s_id: str, pairs: dict[str, tuple[str, float]], names: dict[str, str] | None = None
) -> str:
    shown = names or {}
    if s_id not in pairs:
        return f"{shown.get(s_id, s_id)}{'' if data.a_graph is None else ': not matched'}"
    a_id, confidence = pairs[s_id]
    return f"{shown.get(s_id, s_id)} is {shown.get(a_id, a_id)} ({confidence:.2f})"


def _placed_xy(points: Any, T: Array) -> Array:
    xy = np.asarray(points, dtype=float).reshape(-1, 2)
    return xy @ T[:2, :2].T + T[:2, 3]


def _withdrawn(data: ReportData, planned: dict[str, Mark]) -> list[Mark]:
    """The planned walls that have no anchor any more, with the reason for which they lost the last one."""
    held = {anchor["a_id"] for anchor in data.anchors if anchor["state"] != "withdrawn"}
    last = sorted(data.anchors, key=lambda anchor: (anchor["events"][-1]["stamp_ns"], anchor["a_id"]))
    why = {anchor["a_id"]: anchor["events"][-1]["why"] for anchor in last if anchor["a_id"] not in held}
    return [
        replace(wall, title=f"{wall.title}\nanchor withdrawn: {why[a_id]}")
        for a_id, wall in planned.items()
        if a_id in why
    ]
