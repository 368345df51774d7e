"""The true matches between a map's walls and rooms and the plan's, when the map's true pose is known."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from data import SceneGraph
from data.geometry import se2
from data.geometry.areas import Area, overlap, polygons_of
from data.scene_graph import Room
from evaluation.metrics.surface_overlap import MOST_OFFSET_M, Overlaps, one_storey, overlaps, plan_motion, segments

Array = NDArray[np.float64]
LEAST_SHARE = 0.3  # share of an S surface's length (S room's area) on its A surface (A room)


@dataclass(frozen=True)
class TrueMatches:
    """A ids by S ids; nodes without a true match are left out. `T_a_s` is (yaw, x, y), for a deformed map the best
    rigid fit of the matches; `floor` is the A-graph's; `s_centroid` is `SceneGraph.centroid` of the S-graph."""

    rooms: Mapping[str, str]
    wall_surfaces: Mapping[str, str]
    T_a_s: tuple[float, float, float]
    floor: str | None
    s_centroid: tuple[float, float]


def true_matches(s_graph: SceneGraph, a_graph: SceneGraph, T_bim_map: Array) -> TrueMatches:
    """The matches that follow from the true T_bim_map (4, 4), for a map that is rigid within the limits.

    A wall surface is the A surface on which most of it lies, near ones first: length of the overlap times nearness
    (1 at no offset, 0 at the limit), at least 0.3 of its length. A room is the A room with which it shares most area,
    at least 0.3 of its own.

    Raises UserError for an A-graph of several storeys and for a matrix that is no motion of the plan.
    """
    T_a_s = plan_motion(T_bim_map)
    lying = overlaps_in_plan(s_graph, one_storey(a_graph), T_a_s)
    chosen = best_surfaces(lying)
    walls = {lying.s.ids[i]: lying.a.ids[j] for i, j in enumerate(chosen.tolist()) if j >= 0}
    floors = {w.floor for w in a_graph.wall_surfaces} | {r.floor for r in a_graph.rooms}
    x, y = s_graph.centroid().tolist()
    yaw, tx, ty = T_a_s.tolist()
    return TrueMatches(_rooms(s_graph, a_graph, T_a_s), walls, (yaw, tx, ty), floors.pop() if floors else None, (x, y))


def overlaps_in_plan(s_graph: SceneGraph, a_graph: SceneGraph, T_a_s: Array) -> Overlaps:
    """The overlaps of all S surfaces, under the motion (yaw, x, y), with all A surfaces."""
    return overlaps(segments(s_graph, T_a_s), segments(a_graph, np.zeros(3)))


def best_surfaces(lying: Overlaps) -> NDArray[np.int64]:
    """(S,) the index of the A surface that each S surface is, -1 for none."""
    if not lying.length.size:
        return np.full(len(lying.s.ids), -1)
    enough = lying.length >= LEAST_SHARE * 2 * lying.s.half[:, None]
    score = np.where(enough, lying.length * (1 - np.abs(lying.offset) / MOST_OFFSET_M), 0.0)
    return np.where(score.max(axis=1) > 0, score.argmax(axis=1), -1)


def representatives(truth: TrueMatches, s_graph: SceneGraph) -> tuple[set[str], set[str]]:
    """The S rooms and the S wall surfaces that bear the answer for their true A room or surface.

    Of several pieces of one wall the longest, of several parts of one room the largest (by area, by length of walls
    where a part has no polygon); the first in the graph's order among equals.
    """
    walls = segments(s_graph, np.zeros(3))
    length = dict(zip(walls.ids, (2 * walls.half).tolist(), strict=True))
    around = {r.id: sum(length[w.id] for w in s_graph.surfaces_of_room[r.id]) for r in s_graph.rooms}
    area = {r.id: polygon.area for r in s_graph.rooms if (polygon := room_area(r, np.zeros(3))) is not None}
    rooms = set()
    for parts in _by_target(truth.rooms, list(around)):
        size = area if area.keys() >= set(parts) else around
        rooms.add(max(parts, key=lambda part: size[part]))
    return rooms, {max(parts, key=length.__getitem__) for parts in _by_target(truth.wall_surfaces, list(length))}


def room_area(room: Room, T_out_graph: Array) -> Area | None:
    """The room's footprint under a motion (yaw, x, y); None where it has no polygon of any area."""
    if room.polygon is None or len(room.polygon) < 3:
        return None
    area = polygons_of(shapely.Polygon(se2.apply(T_out_graph, np.array(room.polygon, dtype=float))))
    return area if area.area > 0 else None


def _by_target(pairs: Mapping[str, str], order: list[str]) -> list[list[str]]:
    parts: dict[str, list[str]] = {}
    for s_id in order:
        if s_id in pairs:
            parts.setdefault(pairs[s_id], []).append(s_id)
    return list(parts.values())


def _rooms(s_graph: SceneGraph, a_graph: SceneGraph, T_a_s: Array) -> dict[str, str]:
    planned = {r.id: area for r in a_graph.rooms if (area := room_area(r, np.zeros(3))) is not None}
    found = {}
    for room in s_graph.rooms:
        area = room_area(room, T_a_s)
        if area is not None and planned:
            shared = {key: overlap(area, other).area for key, other in planned.items()}
            best = max(shared, key=shared.__getitem__)
            if shared[best] >= LEAST_SHARE * area.area:
                found[room.id] = best
    return found
