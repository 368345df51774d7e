"""The storeys of an IFC model with the elevations of their finished floors, and its level faces."""

from dataclasses import replace

import ifcopenshell
import ifcopenshell.util.placement
import ifcopenshell.util.unit
import numpy as np
import shapely
from numpy.typing import NDArray

from data.geometry.areas import united
from data.geometry.level_faces import LevelFace, Plane, level_faces
from data.ifc.products import solids, triangulated
from data.scene_graph import Floor
from data.walls.levels import PlannedLevels
from data.walls.rooms import RoomVolume
from data.walls.solids import Solid

STAIRS = ("IfcStair", "IfcStairFlight", "IfcRamp", "IfcRampFlight")
LEVELS = ("IfcSlab", "IfcCovering", "IfcRoof", *STAIRS)
ASTRAY = 1.0  # m: walls that begin further from a storey's stated elevation show that it is stated otherwise


def floors_of(model: ifcopenshell.file, rooms: list[RoomVolume], walls: list[Solid]) -> tuple[Floor, ...]:
    """All IfcBuildingStorey from the lowest up; elevations are z in the BIM frame.

    Where the storey has rooms, its elevation is that of their lower faces (median by area); else what the
    file states, as placement or Elevation, whichever agrees with its walls; else where these begin.
    """
    floors = []
    for storey in {s.GlobalId: s for s in model.by_type("IfcBuildingStorey")}.values():
        own = [r for r in rooms if r.room.floor == storey.GlobalId]
        begins = [w.bottom for w in walls if w.storey == storey.GlobalId]
        elevation = _weighted_median(own) if own else _stated(model, storey, begins)
        floors.append(Floor(storey.GlobalId, storey.Name or storey.LongName or "", elevation))
    return tuple(sorted(floors, key=lambda f: (f.elevation is None, f.elevation or 0.0)))


def floor_of(room: RoomVolume, floors: tuple[Floor, ...]) -> str | None:
    """The room's storey; where the file names none, the highest that its floor is not below."""
    if room.room.floor is not None:
        return room.room.floor
    below = [f for f in floors if f.elevation is not None and f.elevation < room.bottom + ASTRAY / 2]
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
