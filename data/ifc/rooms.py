"""Rooms and storeys of an IFC model: the footprints of its spaces, without those that a robot cannot enter; elevations
of finished floors; level faces."""

from collections import Counter
from dataclasses import replace

import ifcopenshell
import ifcopenshell.util.placement
import ifcopenshell.util.unit
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.polygon import orient

from data.geometry.areas import Area, difference, largest, overlap, polygons_of, united
from data.geometry.level_faces import LevelFace, Plane, level_faces
from data.ifc.products import solids, triangulated
from data.scene_graph import Floor, Room
from data.walls.levels import PlannedLevels
from data.walls.rooms import RoomVolume, finished
from data.walls.solids import Solid

MIN_AREA = 1.0  # m2: below it, a shaft
MIN_HEIGHT = 1.3  # m: below it, a void over a ceiling or under a floor
SAME = 0.9  # of an area: inside, or the same
WALL_HALF = 0.25  # m: what is left of a covering space between its rooms is no wider than a wall
SHOWN = 3  # names of spaces that are left out for one reason
TIDY = 0.001  # m: corners that stand out less are no corners
STAIRS = ("IfcStair", "IfcStairFlight", "IfcRamp", "IfcRampFlight")
LEVELS = ("IfcSlab", "IfcCovering", "IfcRoof", *STAIRS)
STOREY_APART = 1.0  # m: storeys closer to each other (structural and finished level) count once
ASTRAY = 1.0  # m: walls that begin further from a storey's stated elevation show that it is stated otherwise


def rooms_of(model: ifcopenshell.file) -> tuple[list[RoomVolume], list[str]]:
    """Returns the rooms, and one-line notices on spaces that are left out.

    Left out are outer and gross spaces, spaces that only cover other rooms, duplicates, shafts and voids. A space
    within another is a room and is cut out of the other.
    """
    spaces = model.by_type("IfcSpace")
    chosen = {s.GlobalId: s for s in spaces if _is_room(s)}
    bodies = {solid.id: solid for solid in reversed(solids(model, ("IfcSpace",))) if solid.id in chosen}
    volumes: list[RoomVolume] = []
    for solid in reversed(bodies.values()):
        room = Room(solid.id, (0.0, 0.0), solid.storey, _name(chosen[solid.id]))
        volumes.append(RoomVolume(room, _tidy(solid.shadow()), solid.bottom, solid.top))
    large = [v for v in volumes if v.area.area >= MIN_AREA and v.top - v.bottom >= MIN_HEIGHT]
    kept = {v.room.id: v for v in _without_overlaps(large)}
    rooms = [finished(kept[v.room.id]) for v in large if v.room.id in kept]
    kept_after = {  # each reason leaves fewer
        "outer, gross or parts": set(chosen),
        "without solid geometry": {v.room.id for v in volumes},
        f"under {MIN_AREA:g} m2 or {MIN_HEIGHT:g} m high": {v.room.id for v in large},
        "double or covering others": {room.room.id for room in rooms},
    }
    why, left = [], {space.GlobalId: _name(space) or space.GlobalId for space in spaces}
    for reason, kept_ids in kept_after.items():
        if dropped := [name for key, name in left.items() if key not in kept_ids]:
            why.append(f"{len(dropped)} {reason} ({_some(dropped)})")
        left = {key: name for key, name in left.items() if key in kept_ids}
    return rooms, [f"{len(spaces) - len(rooms)} of {len(spaces)} spaces left out: {', '.join(why)}"] if why else []


def _some(names: list[str]) -> str:
    """The first of them, and how many more there are."""
    more = len(names) - SHOWN
    return ", ".join(names[:SHOWN]) + (f" and {more} more" if more > 0 else "")


def _is_room(space: ifcopenshell.entity_instance) -> bool:
    kind = getattr(space, "PredefinedType", None) or getattr(space, "InteriorOrExteriorSpace", None)
    if kind in ("GFA", "EXTERNAL"):
        return False
    children = [c for r in space.IsDecomposedBy for c in r.RelatedObjects if c.is_a("IfcSpace")]
    if space.CompositionType == "COMPLEX" and any(c.Representation for c in children):
        return False
    wholes = [r.RelatingObject for r in space.Decomposes if r.RelatingObject.is_a("IfcSpace")]
    return not (space.CompositionType == "PARTIAL" and any(whole.Representation for whole in wholes))


def _name(space: ifcopenshell.entity_instance) -> str:
    short, long = (space.Name or "").strip(), (space.LongName or "").strip()
    return short if long in short else f"{short} {long}".strip()


def _tidy(area: Area) -> Area:
    polygon = shapely.simplify(largest(polygons_of(area)), TIDY)
    holes = [h for h in polygon.interiors if shapely.Polygon(h).area > 0.01]
    return orient(shapely.Polygon(polygon.exterior, holes))


def _without_overlaps(volumes: list[RoomVolume]) -> list[RoomVolume]:
    """From the smallest up: drops duplicates and covering spaces; larger ones lose what lies within them."""
    kept: list[RoomVolume] = []
    for volume in sorted(volumes, key=lambda v: v.area.area):
        beside = [k for k in kept if k.beside(volume)]
        within = [k for k in beside if overlap(k.area, volume.area).area > SAME * k.area.area]
        rest = difference(volume.area, united(k.area for k in within))
        open_rest = rest.buffer(-WALL_HALF)
        if within and open_rest.area < max(MIN_AREA, (1 - SAME) * volume.area.area):
            continue
        kept.append(replace(volume, area=_tidy(rest)) if within else volume)
    return kept


def floors_of(model: ifcopenshell.file, rooms: list[RoomVolume], walls: list[Solid]) -> tuple[Floor, ...]:
    """All IfcBuildingStorey, else the heights at which most begins, from the lowest up; elevations are z in BIM.

    Where the storey has rooms, its elevation is that of their lower faces (median by area); else what the
    file states, as placement or Elevation, whichever agrees with its walls; else where these begin.
    """
    floors = []
    for storey in {s.GlobalId: s for s in model.by_type("IfcBuildingStorey")}.values():
        own = [r for r in rooms if r.room.floor == storey.GlobalId]
        begins = [w.bottom for w in walls if w.storey == storey.GlobalId]
        elevation = _weighted_median(own) if own else _stated(model, storey, begins)
        floors.append(Floor(storey.GlobalId, storey.Name or storey.LongName or "", elevation))
    if all(f.elevation is None for f in floors):
        floors = []
        for z, _ in Counter(round(body.bottom, 1) for body in rooms or walls).most_common():
            if all(abs(z - (f.elevation or 0.0)) >= STOREY_APART for f in floors):
                floors.append(Floor(f"level {z:.2f}", f"{z:.2f} m", z))
    return tuple(sorted(floors, key=lambda f: (f.elevation is None, f.elevation or 0.0)))


def floor_of(stated: str | None, bottom: float, floors: tuple[Floor, ...]) -> str | None:
    """The stated storey of a body; where the file names none, the highest that its bottom is not below."""
    if stated is not None:
        return stated
    below = [f for f in floors if f.elevation is not None and f.elevation < bottom + ASTRAY / 2]
    return below[-1].id if below else None


def _weighted_median(rooms: list[RoomVolume]) -> float:
    rooms = sorted(rooms, key=lambda r: r.bottom)
    area = np.cumsum([r.area.area for r in rooms])
    return rooms[int(np.searchsorted(area, area[-1] / 2))].bottom


def _stated(model: ifcopenshell.file, storey: ifcopenshell.entity_instance, walls: list[float]) -> float | None:
    scale = ifcopenshell.util.unit.calculate_unit_scale(model)
    stated = []
    if storey.ObjectPlacement is not None:
        placement = ifcopenshell.util.placement.get_local_placement(storey.ObjectPlacement)
        stated.append(float(placement[2, 3]) * scale)
    if storey.Elevation is not None:
        stated.append(float(storey.Elevation) * scale)
    if not walls:
        return stated[0] if stated else None
    begin = float(np.median(walls))
    nearest = min(stated, key=lambda z: abs(z - begin), default=begin)
    if stated and abs(stated[0] - begin) < ASTRAY:
        return stated[0]
    return nearest if abs(nearest - begin) < ASTRAY else begin


def planned_levels(model: ifcopenshell.file, has_spaces: bool) -> PlannedLevels:
    """Reads the level faces of an IFC model, whose rooms are its spaces or (`has_spaces` false) not."""
    bodies = solids(model, LEVELS)
    stairs = [b for b in bodies if b.kind in STAIRS]
    hulls = [
        shapely.MultiPoint(np.concatenate([t.reshape(-1, 3)[:, :2] for t, _ in stair.pieces])).convex_hull
        for stair in stairs
    ]
    faces, with_hulls = [f for b in bodies for f in _faces(b)], tuple(zip(stairs, hulls, strict=True))

    def bounds(room: str) -> NDArray[np.float64] | None:
        mesh = triangulated(model.by_guid(room)) if has_spaces else None
        return None if mesh is None else mesh[0][mesh[1]]

    return PlannedLevels(faces, with_hulls, bounds)


def _faces(body: Solid) -> list[LevelFace]:
    """The level faces of all pieces of a body, those in one plane together."""
    joined = dict[tuple[bool, Plane], list[LevelFace]]()
    for face in (f for triangles, _ in body.pieces for f in level_faces(triangles, body.id, body.kind)):
        a, b, c = np.round(face.plane, 4).tolist()
        joined.setdefault((face.is_floor, (a, b, c)), []).append(face)
    return [replace(own[0], area=united(f.area for f in own)) for own in joined.values()]
