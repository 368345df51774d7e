"""What a plan lacks that a robot would use to find its place in it, storey by storey."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import shapely

from data import Door, Room, SceneGraph
from data.geometry.areas import overlap, polygons_of
from data.synthetic_maps.exploration import Storey, components, storeys_of

SHARED_M2, SHARED = 0.5, 0.05  # of a room's area: more of it in another room's than walls drawn twice leave
STOREY_M = (1.8, 12.0)  # from floor to floor
WALL_M, BUILDING_M = (0.2, 60.0), 2000.0  # a middling wall surface; the whole building


@dataclass(frozen=True)
class Gap:
    """`kind` names it for programs, `told` says it in one line; `ids` are the nodes of the A-graph that it is about."""

    kind: str
    floor: str | None
    told: str
    ids: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Its form in inspection.json."""
        return asdict(self)


def gaps(a: SceneGraph) -> list[Gap]:
    """All that is missing or doubtful, the building's first, then storey by storey from the lowest up."""
    found = [*_units(a), *_elevations(a), *_no_way(a)]
    names = {s.floor: s for s in storeys_of(a)}
    for floor in dict.fromkeys([*(f.id for f in a.floors), *names, *(w.floor for w in a.wall_surfaces)]):
        found += _of_floor(a, floor, names.get(floor))
    return found


def _of_floor(a: SceneGraph, floor: str | None, storey: Storey | None) -> Iterator[Gap]:
    rooms = list(storey.rooms) if storey else [r for r in a.rooms if r.floor == floor]
    ids = {r.id for r in rooms}
    walls = [w for w in a.wall_surfaces if w.room in ids or (w.room is None and w.floor == floor)]
    homeless = [w.id for w in walls if w.room is None]
    if not walls and not rooms:
        yield Gap("empty storey", floor, "no walls and no rooms: nothing to find a place by")
        return
    if not rooms:
        yield Gap("no rooms", floor, f"{_count(len(walls), 'wall surface')} but no room: walls alone are compared")
    elif homeless:
        yield Gap("walls without a room", floor, f"{_count(len(homeless), 'wall surface')} in no room", tuple(homeless))
    if bare := [r for r in rooms if not a.surfaces_of_room[r.id]]:
        told = f"{_named(bare)}: no walls, so nothing tells {_them(bare)} from any other"
        yield Gap("rooms without walls", floor, told, _ids(bare))
    if shapeless := [r for r in rooms if len(r.polygon or ()) < 3]:
        told = f"{_named(shapeless)}: no footprint, drawn as a point"
        yield Gap("rooms without a footprint", floor, told, _ids(shapeless))
    unmeasured = [w.id for w in walls if w.length is None]
    if unmeasured:
        told = f"{_count(len(unmeasured), 'wall surface')} of unknown length"
        yield Gap("walls without a length", floor, told, tuple(unmeasured))
    if storey is not None:
        yield from _ways(a, storey)
        yield from _overlaps(storey)


def _ways(a: SceneGraph, storey: Storey) -> Iterator[Gap]:
    """Rooms without doors, and parts of the storey between which no door leads."""
    doored = {r for d in a.doors for r in d.rooms}
    if not any(r.id in doored for r in storey.rooms):
        if len(storey.rooms) > 1:
            told = "no doors at all: ways from room to room are taken to lead across walls"
            yield Gap("no doors", storey.floor, told)
        return
    shut = [r for r in storey.rooms if r.id not in doored]
    if shut:
        told = f"{_named(shut)}: no door"
        yield Gap("rooms without doors", storey.floor, told, _ids(shut))
    parts = [[storey.rooms[k] for k in part] for part in _parts(storey.by_door) if len(part) > 1]
    if len(parts) > 1:
        told = f"{len(parts)} parts of {', '.join(str(len(p)) for p in parts)} rooms, between which no door leads"
        yield Gap("parts without a way", storey.floor, told, tuple(p[0].id for p in parts))


def _overlaps(storey: Storey) -> Iterator[Gap]:
    areas = [(room, area) for room, area in zip(storey.rooms, storey.areas, strict=True) if area is not None]
    shapes = [polygons_of(area) for _, area in areas]
    pairs = shapely.STRtree(shapes).query(shapes, predicate="intersects").T.tolist() if shapes else []
    for i, j in ((i, j) for i, j in pairs if i < j):
        shared = float(overlap(shapes[i], shapes[j]).area)
        if shared > max(SHARED_M2, SHARED * min(shapes[i].area, shapes[j].area)):
            both = [areas[i][0], areas[j][0]]
            yield Gap("rooms that overlap", storey.floor, f"{_named(both)} share {shared:.1f} m2", _ids(both))


def _no_way(a: SceneGraph) -> Iterator[Gap]:
    """Doors that join nothing; outer doors, which join one room, are as they should be."""
    lost: list[Door] = [d for d in a.doors if not d.rooms]
    if lost:
        told = f"{_count(len(lost), 'door')} beside no room: {'it joins' if len(lost) == 1 else 'they join'} nothing"
        yield Gap("doors that join nothing", None, told, tuple(d.id for d in lost))


def _elevations(a: SceneGraph) -> Iterator[Gap]:
    """Of storeys that hold something: levels of reference lie anywhere."""
    held = {w.floor for w in a.wall_surfaces} | {r.floor for r in a.rooms}
    floors = [f for f in a.floors if f.id in held]
    known = sorted(((f.elevation, f) for f in floors if f.elevation is not None), key=lambda item: item[0])
    if lack := [f for f in floors if f.elevation is None]:
        told = f"{', '.join(f.name or f.id for f in lack)}: no elevation, so height is not anchored there"
        yield Gap("storeys without an elevation", None, told, tuple(f.id for f in lack))
    for (low, f), (high, g) in pairwise(known):
        if not STOREY_M[0] <= high - low <= STOREY_M[1]:
            told = f"{g.name or g.id} lies {high - low:.2f} m above {f.name or f.id}: no storey's height"
            yield Gap("doubtful elevations", None, told, (f.id, g.id))


def _units(a: SceneGraph) -> Iterator[Gap]:
    lengths = [w.length for w in a.wall_surfaces if w.length is not None]
    middle = float(np.median(lengths)) if lengths else 1.0
    if not WALL_M[0] <= middle <= WALL_M[1]:
        told = f"half of the walls are {'under' if middle < 1 else 'over'} {middle:.3g} m long: is the model in metres?"
        yield Gap("doubtful units", None, told)
    places = np.array([w.centroid for w in a.wall_surfaces])
    extent = float(np.ptp(places, axis=0).max()) if len(places) else 0.0
    if extent > BUILDING_M:
        yield Gap("doubtful units", None, f"the walls lie up to {extent:.0f} m apart: is the model in metres?")


def _parts(neighbours: list[list[int]]) -> list[list[int]]:
    """Rooms that hang together, the largest part first."""
    label = components(neighbours)
    return sorted((np.flatnonzero(label == k).tolist() for k in np.unique(label)), key=len, reverse=True)


def _named(rooms: list[Room], most: int = 5) -> str:
    names = [r.name or r.id for r in rooms[:most]]
    return ", ".join(names) + (f" and {len(rooms) - most} more" if len(rooms) > most else "")


def _them(rooms: list[Room]) -> str:
    return "it" if len(rooms) == 1 else "them"


def _ids(rooms: list[Room]) -> tuple[str, ...]:
    return tuple(r.id for r in rooms)


def _count(count: int, what: str) -> str:
    return f"{count:,} {what}{'' if count == 1 else 's'}"
