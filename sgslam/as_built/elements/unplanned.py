"""Walls that stand and that no plan shows: the entries `unplanned` of elements.json."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from data.scene_graph import SceneGraph, WallSurface, Xy
from sgslam.as_built.elements.wall_faces import Face, one_wall_each

Floats = NDArray[np.float64]
UNPLANNED = "unplanned"  # in tables, beside the verdicts on planned elements
_HEIGHT = 2.5  # m of a wall whose height is not known
_BEFORE = 0.3  # m in front of a wall, where the room is that it is seen from


@dataclass(frozen=True)
class UnplannedEntry:
    """One wall that the plan lacks.

    `id` is that of the mapped surface that shows most of it; `surfaces` are all that show it, both faces and pieces.
    `room` and `storey` are the plan's names, empty where it has no room or storey there. `trace` are its two ends in
    plan view, on the face that `facing` (x, y), a unit vector, points away from; `length_m` is their distance.
    `height_m` is the lowest and the highest z that was seen. All in metres in the BIM frame.
    """

    id: str
    room: str
    storey: str
    trace: tuple[Xy, Xy]
    length_m: float
    height_m: tuple[float, float]
    facing: Xy
    surfaces: tuple[str, ...]
    reason: str


def unplanned_walls(
    deviations: Sequence[Mapping[str, Any]], s_graph: SceneGraph, T_bim_map: Floats,
    matches: Mapping[str, Any] | None, plan: SceneGraph,
) -> list[UnplannedEntry]:  # fmt: skip
    """The extra walls of deviations.json, each wall once; `T_bim_map` (4, 4), `matches` as in matches.json."""
    storeys = _storeys(matches or {}, s_graph)
    extra = [(d, s_graph.surface_by_id[d["s_id"]]) for d in deviations if d["kind"] == "extra"]
    by_floor: dict[str, list[Face]] = {}
    for face in (_face(d, surface, s_graph, T_bim_map) for d, surface in extra):
        by_floor.setdefault(face.floor, []).append(face)
    walls = ((floor, wall) for floor, own in by_floor.items() for wall in one_wall_each(own))
    return [_entry(wall, storeys.get(floor), plan) for floor, wall in walls]


def _storeys(matches: Mapping[str, Any], s_graph: SceneGraph) -> dict[str, str | None]:
    """The plan's storey of each floor of the map."""
    placed = matches.get("floors") or {}
    return {floor.id: placed.get(floor.id, matches.get("floor")) for floor in s_graph.floors}


def _face(d: Mapping[str, Any], surface: WallSurface, s_graph: SceneGraph, T_bim_map: Floats) -> Face:
    """A mapped surface in the BIM frame, or the part of it that is not planned; heights are above the map's floor."""
    floor = next((f.elevation for f in s_graph.floors if f.id == surface.floor), None) or 0.0
    low, high = surface.height or (0.0, _HEIGHT)
    corners = np.array([(*xy, floor + z, 1.0) for xy, z in zip(surface.ends(), (low, high), strict=True)])
    first, last = (corners @ T_bim_map.T)[:, :3].tolist()
    nx, ny = (T_bim_map[:2, :2] @ surface.normal).tolist()
    (ax, ay), (bx, by) = d.get("trace") or (first[:2], last[:2])
    trace, heights = ((ax, ay), (bx, by)), (first[2], last[2])
    return Face(surface.id, surface.floor or "", trace, (nx, ny), heights, d.get("reason", ""))


def _entry(wall: Sequence[Face], storey: str | None, plan: SceneGraph) -> UnplannedEntry:
    """The entry of the faces of one wall."""
    longest = max(wall, key=lambda face: face.length)
    n = np.array(longest.normal) / np.linalg.norm(longest.normal)
    middle = np.mean(longest.ends, axis=0)
    tangent = np.array([-n[1], n[0]])
    along = (np.concatenate([face.ends for face in wall]) - middle) @ tangent
    first, last = (middle + at * tangent for at in (along.max(), along.min()))
    floor = next((floor for floor in plan.floors if floor.id == storey), None)
    return UnplannedEntry(
        longest.id, _room((first + last) / 2 + _BEFORE * n, storey, plan),
        (floor.name or floor.id) if floor is not None else "", (_xy(first), _xy(last)), float(np.ptp(along)),
        (min(face.height[0] for face in wall), max(face.height[1] for face in wall)), _xy(n),
        tuple(dict.fromkeys(face.id for face in wall)), longest.reason,
    )  # fmt: skip


def _room(place: Floats, storey: str | None, plan: SceneGraph) -> str:
    """The name of the plan's room that contains a place (2,)."""
    for room in plan.rooms:
        here = storey is None or room.floor in (None, storey)
        if here and room.polygon and shapely.contains_xy(shapely.Polygon(room.polygon), *place):
            return room.name or room.id
    return ""


def _xy(place: Floats) -> Xy:
    x, y = place.tolist()
    return x, y
