"""The storeys of an IFC model and the elevations of their finished floors."""

import ifcopenshell
import ifcopenshell.util.placement
import ifcopenshell.util.unit
import numpy as np

from data.ifc.rooms import RoomVolume
from data.ifc.sections import Solid
from data.scene_graph import Floor

ASTRAY = 1.0  # m: walls that begin further from a storey's stated elevation show that it is stated otherwise


def floors_of(model: ifcopenshell.file, rooms: list[RoomVolume], solids: list[Solid]) -> tuple[Floor, ...]:
    """All IfcBuildingStorey from the lowest up; elevations are z in the BIM frame.

    Where the storey has rooms, its elevation is that of their lower faces (median by area); else what the
    file states, as placement or Elevation, whichever agrees with its walls; else where these begin.
    """
    floors = []
    for storey in {s.GlobalId: s for s in model.by_type("IfcBuildingStorey")}.values():
        own = [r for r in rooms if r.room.floor == storey.GlobalId]
        walls = [s.bottom for s in solids if s.product.storey == storey.GlobalId]
        elevation = _weighted_median(own) if own else _stated(model, storey, walls)
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
