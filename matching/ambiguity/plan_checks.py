"""Checks of a plan: what is missing or implausible for localisation, storey by storey."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely

from data import Door, Floor, Room, SceneGraph, WallSurface
from data.geometry.areas import overlap, polygons_of
from data.plans.flat_plan import THICKEST
from data.synthetic_maps.exploration import SQUARE, Storey, components, storeys_of

OVERLAP_M2, OVERLAP_SHARE = 0.5, 0.05  # of a room's area: more than duplicate walls cause
STOREY_M = (1.8, 12.0)  # plausible height from floor to floor
WALL_M, BUILDING_M = (0.2, 60.0), 2000.0  # plausible median length of walls; extent of the building


@dataclass(frozen=True)
class PlanIssue:
    """Something missing or implausible in a plan.

    `kind` is a fixed phrase for programs, `message` one line for the user; `ids` are the affected A-graph nodes.
    """

    kind: str
    floor: str | None
    message: str
    ids: tuple[str, ...] = ()


def plan_issues(a: SceneGraph) -> list[PlanIssue]:
    """All issues: those of the whole building first, then storey by storey from the lowest up."""
    found = [*_units(a), *_elevations(a), *_unconnected_doors(a)]
    names = {s.floor: s for s in storeys_of(a)}
    roomless = [w.floor for w in a.wall_surfaces if w.room is None]
    for floor in dict.fromkeys([*(f.id for f in a.floors), *names, *roomless]):
        found += _storey_issues(a, floor, names.get(floor))
    return found


def _storey_issues(a: SceneGraph, floor: str | None, storey: Storey | None) -> Iterator[PlanIssue]:
    rooms = list(storey.rooms) if storey else [r for r in a.rooms if r.floor == floor]
    ids = {r.id for r in rooms}
    walls = [w for w in a.wall_surfaces if w.room in ids or (w.room is None and w.floor == floor)]
    if not walls and not rooms:
        yield PlanIssue("empty storey", floor, "no walls and no rooms: localisation is impossible there")
        return
    if not rooms:
        message = f"{_count(len(walls), 'wall surface')} but no rooms: only walls can be matched"
        yield PlanIssue("no rooms", floor, message)
    elif roomless := walls_without_room(walls):
        message = f"walls and columns that bound no room: {count_walls(roomless):,}"
        yield PlanIssue("walls without a room", floor, message, _ids(roomless))
    if bare := [r for r in rooms if not a.surfaces_of_room[r.id]]:
        message = f"{_named(bare)}: no walls, so {'it' if len(bare) == 1 else 'they'} cannot be recognised"
        yield PlanIssue("rooms without walls", floor, message, _ids(bare))
    if shapeless := [r for r in rooms if len(r.polygon or ()) < 3]:
        message = f"{_named(shapeless)}: no footprint; drawn as a point"
        yield PlanIssue("rooms without a footprint", floor, message, _ids(shapeless))
    if unmeasured := [w for w in walls if w.length is None]:
        message = f"{_count(len(unmeasured), 'wall surface')} of unknown length"
        yield PlanIssue("walls without a length", floor, message, _ids(unmeasured))
    if storey is not None:
        yield from _connectivity(a, storey)
        yield from _overlaps(storey)


def walls_without_room(surfaces: Sequence[WallSurface]) -> list[WallSurface]:
    """The surfaces of those walls and columns of a storey that bound no room: no side of theirs faces one."""
    facing = [w for w in surfaces if w.room is not None]
    sources = {w.source for w in facing if w.source}
    tree = shapely.STRtree([shapely.LineString(w.ends()) for w in facing])

    def has_room_behind(w: WallSurface) -> bool:
        near = tree.query(shapely.LineString(w.ends()), predicate="dwithin", distance=THICKEST).tolist()
        backs = (facing[k] for k in near if np.dot(facing[k].normal, w.normal) < -np.cos(SQUARE))
        return any(np.dot(np.subtract(back.centroid, w.centroid), w.normal) < 0 for back in backs)

    return [w for w in surfaces if w.room is None and w.source not in sources and not has_room_behind(w)]


def count_walls(surfaces: Sequence[WallSurface]) -> int:
    """How many walls and columns these surfaces are of; each is one of its own where the plan has no names for them."""
    return len({w.source or w.id for w in surfaces})


def _connectivity(a: SceneGraph, storey: Storey) -> Iterator[PlanIssue]:
    """Rooms without doors, and groups of rooms that no door connects."""
    with_doors = {r for d in a.doors for r in d.rooms}
    if not any(r.id in with_doors for r in storey.rooms):
        if len(storey.rooms) > 1:
            message = "no doors: paths between rooms are assumed to cross the walls"
            yield PlanIssue("no doors", storey.floor, message)
        return
    if closed := [r for r in storey.rooms if r.id not in with_doors]:
        message = f"{_named(closed)}: no door"
        yield PlanIssue("rooms without doors", storey.floor, message, _ids(closed))
    first, size = np.unique(components(storey.by_door), return_index=True, return_counts=True)[1:]
    groups = [k for k in np.argsort(-size, kind="stable") if size[k] > 1]  # the largest first
    if len(groups) > 1:
        message = f"{len(groups)} groups of {', '.join(str(size[k]) for k in groups)} rooms that no door connects"
        ids = tuple(storey.rooms[first[k]].id for k in groups)
        yield PlanIssue("unconnected groups of rooms", storey.floor, message, ids)


def _overlaps(storey: Storey) -> Iterator[PlanIssue]:
    areas = [(room, area) for room, area in zip(storey.rooms, storey.areas, strict=True) if area is not None]
    shapes = [polygons_of(area) for _, area in areas]
    pairs = shapely.STRtree(shapes).query(shapes, predicate="intersects").T.tolist() if shapes else []
    for i, j in ((i, j) for i, j in pairs if i < j):
        shared = float(overlap(shapes[i], shapes[j]).area)
        if shared > max(OVERLAP_M2, OVERLAP_SHARE * min(shapes[i].area, shapes[j].area)):
            both = [areas[i][0], areas[j][0]]
            yield PlanIssue("overlapping rooms", storey.floor, f"{_named(both)} share {shared:.1f} m2", _ids(both))


def _unconnected_doors(a: SceneGraph) -> Iterator[PlanIssue]:
    """Doors next to no room; entrances, which lead to one room, are fine."""
    if lost := [d for d in a.doors if not a.room_by_id.keys() & set(d.rooms)]:
        message = f"{_count(len(lost), 'door')} that are next to no room"
        yield PlanIssue("doors without a room", None, message, _ids(lost))


def _elevations(a: SceneGraph) -> Iterator[PlanIssue]:
    """Only of storeys that are not empty: reference levels may have any elevation."""
    held = {w.floor for w in a.wall_surfaces} | {r.floor for r in a.rooms}
    floors = [f for f in a.floors if f.id in held]
    known = sorted(((f.elevation, f) for f in floors if f.elevation is not None), key=lambda item: item[0])
    if lack := [f for f in floors if f.elevation is None]:
        message = f"{', '.join(f.name or f.id for f in lack)}: no elevation, so the height is not anchored there"
        yield PlanIssue("storeys without an elevation", None, message, _ids(lack))
    for (low, f), (high, g) in pairwise(known):
        if not STOREY_M[0] <= high - low <= STOREY_M[1]:
            names = f"{g.name or g.id} is {high - low:.2f} m above {f.name or f.id}"
            message = f"{names}, which is implausible for a storey"
            yield PlanIssue("implausible elevations", None, message, (f.id, g.id))


def _units(a: SceneGraph) -> Iterator[PlanIssue]:
    lengths = [w.length for w in a.wall_surfaces if w.length is not None]
    median = float(np.median(lengths)) if lengths else 1.0
    if not WALL_M[0] <= median <= WALL_M[1]:
        message = f"the median wall length is {median:.3g} m; check the model's units"
        yield PlanIssue("implausible units", None, message)
    places = np.array([w.centroid for w in a.wall_surfaces])
    extent = float(np.ptp(places, axis=0).max()) if len(places) else 0.0
    if extent > BUILDING_M:
        message = f"the walls are up to {extent:.0f} m apart; check the model's units"
        yield PlanIssue("implausible units", None, message)


def _named(rooms: list[Room], most: int = 5) -> str:
    names = [r.name or r.id for r in rooms[:most]]
    return ", ".join(names) + (f" and {len(rooms) - most} more" if len(rooms) > most else "")


def _ids(nodes: Sequence[Room | WallSurface | Door | Floor]) -> tuple[str, ...]:
    return tuple(node.id for node in nodes)


def _count(count: int, what: str) -> str:
    return f"{count:,} {what}{'' if count == 1 else 's'}"
