"""An IFC model as an A-graph: storeys, rooms, wall and level surfaces and doors in the BIM frame."""

from bisect import bisect_left
from collections import Counter, defaultdict
from dataclasses import replace
from functools import cache
from pathlib import Path

import ifcopenshell
import numpy as np
import shapely
from ifcopenshell.util.element import get_parts

from data.common.errors import UserError
from data.geometry.areas import Area, united
from data.ifc.doors import doors_of, rooms_between
from data.ifc.georeference import georeference_of
from data.ifc.products import open_ifc, solids
from data.ifc.rooms import STOREY_APART, floor_of, floors_of, planned_levels, rooms_of
from data.scene_graph import Floor, SceneGraph, WallSurface, implausible
from data.walls.levels import level_surfaces
from data.walls.rooms import Level, RoomVolume, open_area
from data.walls.solids import Solid
from data.walls.surfaces import CUTS, surfaces_at

WALLS = ("IfcWall", "IfcCurtainWall")
COLUMNS = ("IfcColumn",)
SAME_LEVEL = 0.25  # m: floors of one level differ by less
HEAD = 2.0  # m: a wall that reaches this far above a storey's floor stands in that storey too
NEAR = 1.0  # m before a wall: what stands further hides nothing of it
SLIT = 0.05  # m: walls closer to each other leave no way between them


def read_ifc(path: Path | str) -> tuple[SceneGraph, tuple[str, ...]]:
    """The A-graph of an IFC file (frame "bim"), and one-line notices on what is missing in the model.

    Raises UserError for a file that cannot be read or has no walls.
    """
    model = open_ifc(path)
    every = [wall for kind in WALLS for wall in model.by_type(kind)]
    # a wall that is made of walls is these
    parts = [[part for part in get_parts(w) if any(part.is_a(kind) for kind in WALLS)] for w in every]
    count = sum(w.Representation is not None or not own for w, own in zip(every, parts, strict=True))
    made = solids(model, WALLS)
    shadows = {s.id: s.shadow() for s in made}
    walls = [s for s in made if _stands(s, shadows[s.id])]
    columns = solids(model, COLUMNS)
    if not walls:
        lack = "no walls" if not count else f"no walls with a geometry ({count} without)"
        raise UserError(f"{path}: has {lack} (IfcWall, IfcCurtainWall); export the walls with their geometry")
    rooms, notices = rooms_of(model)
    floors, has_spaces = floors_of(model, rooms, walls), bool(rooms)
    if not model.by_type("IfcBuildingStorey"):
        notices.append(f"no IfcBuildingStorey: {len(floors)} made of the heights at which rooms or walls begin")
    notices += _used_twice(model)
    walls, columns = (
        [replace(s, storey=floor_of(s.storey, s.bottom, floors)) for s in own] for own in (walls, columns)
    )
    if has_spaces:
        rooms = [replace(r, room=replace(r.room, floor=floor_of(r.room.floor, r.bottom, floors))) for r in rooms]
        levels = _levels(floors, rooms, [*walls, *columns], shadows)
        if bare := [f.name or f.id for f in floors if f.id in {lv.floor for lv in levels if not lv.rooms}]:
            notices.append(f"no rooms on {', '.join(bare)}: walls but no IfcSpace; wall surfaces alone are used there")
    else:
        levels = rooms_between(model, _levels_without_rooms(floors, walls, columns), [*walls, *columns])
        rooms = [r for level in levels for r in level.rooms]
        notices.insert(0, _no_spaces(rooms, walls))
    surfaces = _numbered([s for level in levels for s in surfaces_at(level, _near(level, [*walls, *columns]))])
    if len(walls) < count:
        notices.append(f"{count - len(walls)} of {count} walls have no geometry or lie flat, and are left out")
    doors = doors_of(model, rooms, shadows)

    def walls_at(area: Area, z: float) -> Area:
        standing = (shadows[s.id] for s in walls if s.bottom < z < s.top)
        return united(shadow for shadow in standing if shadow.intersects(area))

    levels_seen = level_surfaces(planned_levels(model, has_spaces), rooms, floors, walls_at)
    known, wrong_reference = georeference_of(model)
    notices += wrong_reference
    rooms_seen = tuple(r.room for r in rooms)
    graph = SceneGraph("bim", rooms_seen, surfaces, doors, floors, level_surfaces=levels_seen, georeference=known)
    if (wrong := implausible(graph)) is not None:
        notices.append(wrong)
    return graph, tuple(notices)


def _used_twice(model: ifcopenshell.file) -> list[str]:
    """A notice on elements and spaces with the GlobalId of another."""
    used = Counter(e.GlobalId for c in ("IfcElement", "IfcSpatialStructureElement") for e in model.by_type(c))
    twice = [global_id for global_id, times in used.items() if times > 1]
    if not twice:
        return []
    return [f"GlobalIds given more than once: {len(twice)} ({twice[0]}); one element of each may be missing; mend them"]


def _stands(solid: Solid, shadow: Area) -> bool:
    """Whether more of a body's surface is upright than level: floors are exported as walls too."""
    return (solid.top - solid.bottom) * shadow.length > 2 * shadow.area


def _no_spaces(rooms: list[RoomVolume], walls: list[Solid]) -> str:
    why = "no IfcSpace with a geometry"
    if not rooms:
        return f"{why}: no rooms, since the {len(walls)} walls enclose none; wall surfaces alone are used"
    made = "1 room was" if len(rooms) == 1 else f"{len(rooms)} rooms were"
    return f"{why}: {made} made of the closed faces between {len(walls)} walls"


def _levels(
    floors: tuple[Floor, ...], rooms: list[RoomVolume], solids: list[Solid], shadows: dict[str, Area]
) -> list[Level]:
    """The levels at which walls are cut: at each storey's rooms, and in storeys with walls but no rooms.

    Of storeys at one height, the walls of each are its own. `solids` are walls and columns, `shadows` those of walls.
    """
    walls = [s for s in solids if s.id in shadows]
    open_at = cache(lambda z: _open(z, rooms, walls, shadows))  # several buildings' storeys lie at one height
    levels = []
    elevation = {f.id: f.elevation for f in floors}
    of_floor: dict[str | None, list[RoomVolume]] = defaultdict(list)
    for room in sorted(rooms, key=lambda r: r.bottom):
        of_floor[room.room.floor].append(room)
    for floor, here in of_floor.items():
        groups: list[list[RoomVolume]] = []
        for room in here:
            if groups and room.bottom - groups[-1][0].bottom < SAME_LEVEL:
                groups[-1].append(room)
            else:
                groups.append([room])
        main = max(groups, key=lambda g: sum(r.area.area for r in g))
        for group in groups:
            bottom = float(np.median([r.bottom for r in group]))
            top = max(r.top for r in group)
            outside = open_at(bottom) if group is main else shapely.Polygon()
            levels.append(Level(floor, bottom, top, tuple(group), outside))
    for floor in Counter(s.storey for s in walls):
        z = elevation.get(floor) if floor is not None else None
        beside = (lv for lv in levels if z is not None and abs(lv.bottom - z) < STOREY_APART)
        if z is not None and floor not in of_floor and not any(beside):
            top = max(s.top for s in walls)
            levels.append(Level(floor, z, top, (), open_at(z)))
    return [replace(level, own=_own(level, levels, solids)) for level in levels]


def _own(level: Level, levels: list[Level], solids: list[Solid]) -> frozenset[str] | None:
    """The walls and columns without those of other storeys at this height; None if there are no such storeys."""
    near = {lv.floor for lv in levels if abs(lv.bottom - level.bottom) < STOREY_APART} - {level.floor}
    return frozenset(s.id for s in solids if s.storey not in near) if near else None


def _near(level: Level, solids: list[Solid]) -> list[Solid]:
    """Of the storeys at one height, what stands in the rectangle about a level's rooms and its own walls."""
    if level.own is None:
        return solids
    standing = [s for s in solids if s.bottom < level.bottom + CUTS[-1] and s.top > level.bottom + CUTS[0]]
    plans = [shapely.box(*s.corners[:, :2].min(axis=0), *s.corners[:, :2].max(axis=0)) for s in standing]
    inside = [plan for s, plan in zip(standing, plans, strict=True) if s.id in level.own]
    around = shapely.box(*shapely.total_bounds([*inside, *(r.area for r in level.rooms)])).buffer(NEAR)
    return [s for s, plan in zip(standing, plans, strict=True) if plan.intersects(around)]


def _open(z: float, rooms: list[RoomVolume], walls: list[Solid], shadows: dict[str, Area]) -> Area:
    """The open area at the level of `z`; doors and windows are closed, so that walls have no sides in them."""
    standing = [shadows[s.id] for s in walls if s.bottom < z + HEAD / 2 < s.top]
    return open_area(united(standing).buffer(SLIT), (r.area for r in rooms if r.bottom < z + HEAD / 2 < r.top))


def _levels_without_rooms(floors: tuple[Floor, ...], walls: list[Solid], columns: list[Solid]) -> list[Level]:
    """One level for each storey with walls; a wall stands where it begins and in storeys it spans."""
    walls_of = Counter(s.storey for s in walls)
    chosen: list[tuple[float, str]] = []
    for storey in sorted(floors, key=lambda f: (-walls_of[f.id], f.elevation or 0.0)):
        z = storey.elevation
        if z is not None and walls_of[storey.id] and all(abs(z - other) >= STOREY_APART for other, _ in chosen):
            chosen.append((z, storey.id))
    chosen.sort(key=lambda c: c[0])
    heights, levels = [z for z, _ in chosen], []
    homes = [(s, max(bisect_left(heights, s.bottom + STOREY_APART / 2) - 1, 0)) for s in [*walls, *columns]]
    for k, (z, floor) in enumerate(chosen):
        top = heights[k + 1] if k + 1 < len(chosen) else max(z, *(s.top for s in walls))
        own = (s.id for s, home in homes if home == k or (s.bottom < z + SAME_LEVEL and s.top > z + HEAD))
        levels.append(Level(floor, z, top, own=frozenset(own)))
    return levels


def _numbered(surfaces: list[WallSurface]) -> tuple[WallSurface, ...]:
    """Ids from the walls' GlobalIds, the same each time the same file is read; those that face a room come first."""
    count: Counter[str] = Counter()
    result = []
    for surface in sorted(surfaces, key=lambda s: s.room is None):
        count[surface.source] += 1
        result.append(replace(surface, id=f"{surface.source}/{count[surface.source]}"))
    return tuple(result)
