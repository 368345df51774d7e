"""A drawn plan (rooms, doors and walls as polygons) as a scene graph: every room edge with a wall is a wall surface.

Metres, in the plan's own frame, which becomes `bim`.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.polygon import orient

from data.geometry.areas import Area, difference, largest, opened, overlap, polygons_of
from data.geometry.intervals import Intervals, united, without
from data.scene_graph import Door, Floor, Room, SceneGraph, WallSurface
from data.walls.rooms import outlined, width_of

Points = NDArray[np.float64]  # (N, 2)
FLAT = 0.01  # m: corners that stand out less are no corners of a wall
MIN_EDGE = 0.05  # m: shorter edges are no surfaces
OPEN = 0.04  # m: rooms that come closer have no wall between them (the published regime's threshold as well)
REACH = 0.25  # m: a room begins this close to a door's side
MIN_OVERLAP = 0.01  # m2: less is drawing inaccuracy
SLIVER = 0.1  # m: parts of rooms that are narrower are drawing inaccuracy
SAME = 0.9  # of an area: a double
NARROW = 0.5  # m: no part of a room that was cut is narrower


@dataclass(frozen=True)
class Plan:
    """One plan to match against: an A-graph in frame `bim`, and the building that it is a part of.

    `name` is unique within its source; plans of one building must never be split between training and test.
    """

    name: str
    building: str
    graph: SceneGraph


@dataclass(frozen=True)
class DrawnRoom:
    """A room's `area` (a polygon, holes are pillars); `height` is (z of the floor, z of the ceiling)."""

    id: str
    area: Area
    name: str = ""
    floor: str | None = None
    height: tuple[float, float] | None = None


def scene_graph_of(
    rooms: Sequence[DrawnRoom],
    doors: Iterable[tuple[str, Area]],
    walls: Area,
    floors: tuple[Floor, ...] = (),
    merge_collinear: bool = True,
) -> SceneGraph:
    """The A-graph of one storey: its rooms, its doors with their ids, and the area of walls, railings and windows,
    where these are drawn.

    A room's edges become wall surfaces in the order of its rings (outer, then holes), normals into the room; what of an
    edge lies within `OPEN` of another room with no wall drawn between is a passage, no wall. Collinear neighbours are
    merged (corners that stand out less than `FLAT`, curves become chords), edges below `MIN_EDGE` are left out, and
    rooms that overlap are cut: doubles fall out, the larger loses what the smaller covers.

    With `merge_collinear=False` every raw edge of every outer ring is a surface, whatever lies behind it: the published
    matcher's graphs (Modified Swiss Dwellings apartments).
    """
    rooms = _without_overlaps(rooms, walls) if merge_collinear else rooms
    rooms = [replace(r, area=tidied(r.area)) if merge_collinear else r for r in rooms if r.area.area > 0]
    edges = [edges_of(r.area, holes=merge_collinear) for r in rooms]
    gaps = rooms_behind([r.area for r in rooms], edges, OPEN, walls) if merge_collinear else {}
    surfaces: list[WallSurface] = []
    for k, room in enumerate(rooms):
        surfaces += surfaces_of(room, edges[k], gaps.get(k, {}), MIN_EDGE if merge_collinear else 0.0)
    found = [_door(*door, rooms) for door in doors] + _open_doors(rooms, edges, gaps)
    known = tuple(d for d in found if d.rooms)
    return SceneGraph("bim", tuple(room_of(r) for r in rooms), tuple(surfaces), known, floors)


def with_pillars(rooms: Sequence[DrawnRoom], walls: Area) -> list[DrawnRoom]:
    """The rooms with holes where walls or columns stand free in them."""
    parts = shapely.get_parts(walls)
    tree = shapely.STRtree(parts)
    free = (parts[tree.query(room.area, predicate="contains_properly")] for room in rooms)
    holes = (shapely.MultiPolygon(list(f)) for f in free)
    return [replace(r, area=difference(r.area, h)) if not h.is_empty else r for r, h in zip(rooms, holes, strict=True)]


def room_of(room: DrawnRoom) -> Room:
    """The graph's room: its outer ring and that ring's centroid."""
    return outlined(Room(room.id, (0.0, 0.0), room.floor, room.name), room.area)


def _without_overlaps(rooms: Sequence[DrawnRoom], walls: Area) -> list[DrawnRoom]:
    """Slivers and doubles fall out; of two rooms the larger loses what the smaller covers, and walls around it."""
    ordered = sorted(rooms, key=lambda r: r.area.area)
    areas = [largest(opened(polygons_of(r.area), SLIVER / 2)) for r in ordered]
    tree = shapely.STRtree(areas)
    kept: dict[int, Area] = {}
    for k, area in enumerate(areas):
        for other in sorted(int(j) for j in tree.query(area, predicate="intersects")):
            if other not in kept:
                continue
            shared = overlap(kept[other], area).area
            if shared > SAME * area.area:
                area = shapely.Polygon()
                break
            if shared > MIN_OVERLAP:
                rest = difference(difference(area, kept[other]), walls)
                area = largest(opened(rest, NARROW / 2))
        if not area.is_empty:
            kept[k] = largest(area)
    of_id = {ordered[k].id: area for k, area in kept.items()}
    return [replace(r, area=of_id[r.id]) for r in rooms if r.id in of_id]


def tidied(area: Area) -> Area:
    """A polygon without needless corners; each ring begins at its corner farthest from the middle, which stays."""
    rings = []
    for ring in (area.exterior, *area.interiors):
        points = np.asarray(ring.coords)[:-1]
        first = int(np.argmax(np.hypot(*(points - points.mean(axis=0)).T).round(6)))
        points = np.roll(points, -first, axis=0)
        line = shapely.simplify(shapely.LinearRing(points), FLAT)
        rings.append(np.asarray(line.coords) if len(line.coords) > 3 else np.asarray(ring.coords))
    tidy = shapely.Polygon(rings[0], [r for r in rings[1:] if shapely.Polygon(r).area > FLAT])
    return tidy if tidy.is_valid else area


def edges_of(area: Area, holes: bool = True) -> Points:
    """(N, 2, 2) the edges of the rings, the room to their left."""
    rings = [orient(area).exterior, *(orient(area).interiors if holes else ())]
    edges = [np.stack([p[:-1], p[1:]], axis=1) for p in (np.asarray(ring.coords) for ring in rings)]
    every = np.concatenate(edges)
    return every[np.hypot(*(every[:, 1] - every[:, 0]).T) > 1e-6]


def frame_of(edges: Points) -> tuple[Points, Points, NDArray[np.float64]]:
    """Unit vectors along the edges and into the room, and the lengths."""
    step = edges[:, 1] - edges[:, 0]
    length = np.hypot(*step.T)
    along = step / length[:, None]
    return along, np.stack([-along[:, 1], along[:, 0]], axis=1), length


Gaps = dict[int, dict[int, list[tuple[int, Intervals]]]]  # room, edge: rooms behind it and where, in metres along


def rooms_behind(rooms: Sequence[Area], edges: Sequence[Points], reach: float, walls: Area | None = None) -> Gaps:
    """Where another room is met `reach` metres behind one of the `edges` of each, other than through `walls`."""
    owner = np.repeat(np.arange(len(rooms)), [len(e) for e in edges])
    number = np.concatenate([np.arange(len(e)) for e in edges]) if edges else np.zeros(0, int)
    every = np.concatenate(edges) if edges else np.zeros((0, 2, 2))
    along, inward, _ = frame_of(every)
    behind = shapely.linestrings(every - reach * inward[:, None])
    tree = shapely.STRtree(rooms)
    built = walls.buffer(OPEN) if walls is not None else shapely.Polygon()
    gaps: Gaps = {}
    for line, other in tree.query(behind, predicate="intersects").T.tolist():
        room = int(owner[line])
        if other == room:
            continue
        seen = difference(overlap(behind[line], rooms[other]), built)
        spans = _spans(seen, every[line, 0], along[line])
        if spans:
            gaps.setdefault(room, {}).setdefault(int(number[line]), []).append((other, spans))
    return gaps


def _spans(seen: Area, start: Points, along: Points) -> Intervals:
    parts = [p for p in shapely.get_parts(seen) if p.length > MIN_EDGE]
    reach = [(np.asarray(p.coords) - start) @ along for p in parts]
    return united([(float(u.min()), float(u.max())) for u in reach])


def surfaces_of(
    room: DrawnRoom, edges: Points, gaps: dict[int, list[tuple[int, Intervals]]], shortest: float
) -> list[WallSurface]:
    """The room's wall surfaces: its edges without their gaps."""
    along, inward, lengths = frame_of(edges)
    surfaces: list[WallSurface] = []
    for k, length in enumerate(lengths.tolist()):
        spans: Intervals = [(0.0, length)]
        if k in gaps:
            spans = without(spans, united([s for _, some in gaps[k] for s in some]))
        for low, high in spans:
            if high - low >= shortest:
                x, y = (edges[k, 0] + along[k] * (low + high) / 2).tolist()
                name = f"{room.id}/{len(surfaces)}"
                nx, ny = inward[k].tolist()
                plane = (nx, ny, 0.0, -(nx * x + ny * y))
                surfaces.append(
                    WallSurface(name, room.id, (x, y), (nx, ny), high - low, room.floor, "", room.height, plane)
                )
    return surfaces


def _door(id: str, area: Area, rooms: Sequence[DrawnRoom]) -> Door:
    """The rooms on both sides of a door, across its thinner side, else across the wider (a door as deep as wide)."""
    corners = np.asarray(shapely.oriented_envelope(area).exterior.coords)[:3]
    centre = area.centroid
    sides = sorted((corners[1] - corners[0], corners[2] - corners[1]), key=lambda s: float(np.hypot(*s)))
    best: tuple[str, ...] = ()
    for side in sides:
        half = side / 2 + REACH * side / max(float(np.hypot(*side)), 1e-9)
        met = []
        for sign in (1, -1):
            ray = shapely.LineString([(centre.x, centre.y), (centre.x + sign * half[0], centre.y + sign * half[1])])
            here = [r for r in rooms if r.area.intersects(ray)]
            met += [min(here, key=lambda r: centre.distance(overlap(ray, r.area))).id] if here else []
        found = tuple(dict.fromkeys(met))
        best = found if len(found) > len(best) else best
        if len(best) == 2:
            break
    return Door(id, best, (float(centre.x), float(centre.y)), width_of(area))


def _open_doors(rooms: Sequence[DrawnRoom], edges: list[Points], gaps: Gaps) -> list[Door]:
    """One passage for each pair of rooms with no wall between them, at the middle of their widest common opening."""
    widest: dict[tuple[int, int], tuple[float, tuple[float, float]]] = {}
    for room, of_edge in gaps.items():
        along, _, _ = frame_of(edges[room])
        for k, found in of_edge.items():
            for other, spans in found:
                low, high = max(spans, key=lambda s: s[1] - s[0])
                x, y = (edges[room][k, 0] + along[k] * (low + high) / 2).tolist()
                pair = (min(room, other), max(room, other))
                widest[pair] = max(widest.get(pair, (0.0, (0.0, 0.0))), (high - low, (x, y)))
    named = [((rooms[a].id, rooms[b].id), at) for (a, b), (_, at) in sorted(widest.items())]
    return [Door(f"passage {a} - {b}", (a, b), at) for (a, b), at in named]
