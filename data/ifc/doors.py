"""Doors of an IFC model: their positions and the rooms they join."""

from collections.abc import Callable

import ifcopenshell
import ifcopenshell.util.placement
import numpy as np
import shapely
from numpy.typing import NDArray

from data.geometry.areas import Area, overlap, polygons_of
from data.ifc.products import triangulated
from data.scene_graph import Door
from data.walls.rooms import RoomVolume

REACH = 1.0  # m: a room begins this close to the middle of a door
STANDING = 0.3  # m of a room in front of a door, enough to stand in it
ABOVE_SILL = 0.5  # m


def doors_of(model: ifcopenshell.file, rooms: list[RoomVolume], walls: dict[str, Area]) -> tuple[Door, ...]:
    """Returns every IfcDoor with a position; `walls` are the walls' areas in plan by GlobalId."""
    entities = {door.GlobalId: door for door in model.by_type("IfcDoor")}
    tree = shapely.STRtree([room.area for room in rooms])

    def near(x: float, y: float) -> list[RoomVolume]:
        return [rooms[k] for k in sorted(tree.query(shapely.box(x - REACH, y - REACH, x + REACH, y + REACH)).tolist())]

    found = (_door(door, near, walls) for door in entities.values())
    return tuple(door for door in found if door is not None)


def _door(
    door: ifcopenshell.entity_instance, near: Callable[[float, float], list[RoomVolume]], walls: dict[str, Area]
) -> Door | None:
    """Uses the middle of the opening in its wall, since a door's own shape may include an open leaf."""
    vertices, host = body_of(door)
    if vertices is None:
        return None
    through = across(door)
    centre = _middle(vertices[:, :2], through)
    hull = shapely.MultiPoint(vertices[:, :2]).convex_hull
    within = polygons_of(overlap(hull, walls[host])) if host in walls else shapely.Polygon()
    if not within.is_empty:
        centre = _middle(np.asarray(shapely.get_coordinates(within)), through)
    z = float(vertices[:, 2].min()) + ABOVE_SILL
    here = [r for r in near(*centre.tolist()) if r.bottom < z < r.top]
    along = np.array([-through[1], through[0]])
    joined = _rooms_beside(centre, through, here) or _rooms_beside(centre, along, here)
    return Door(door.GlobalId, joined, (float(centre[0]), float(centre[1])))


def body_of(filling: ifcopenshell.entity_instance) -> tuple[NDArray[np.float64] | None, str | None]:
    """Vertices (N, 3) of the opening that a door or window fills, or of itself, and the GlobalId of the wall."""
    host, opening = None, None
    for fills in filling.FillsVoids:
        if (filled := fills.RelatingOpeningElement) is None:  # the model refers to what it lacks
            continue
        opening = triangulated(filled)
        wall = filled.VoidsElements[0].RelatingBuildingElement if filled.VoidsElements else None
        host = None if wall is None else wall.GlobalId
    mesh = opening or triangulated(filling)
    return (mesh[0] if mesh else None), host


def across(door: ifcopenshell.entity_instance) -> NDArray[np.float64]:
    """(2,) unit, through the door or window: the y axis of its placement."""
    axis = ifcopenshell.util.placement.get_local_placement(door.ObjectPlacement)[:2, 1]
    norm = float(np.linalg.norm(axis))
    return axis / norm if norm > 0.5 else np.array([0.0, 1.0])


def _middle(points: NDArray[np.float64], across: NDArray[np.float64]) -> NDArray[np.float64]:
    """The middle of the rectangle about the points whose sides lie along and across the door."""
    axes = np.array([across, [-across[1], across[0]]])
    u = points @ axes.T
    return (u.min(axis=0) + u.max(axis=0)) / 2 @ axes


def _rooms_beside(centre: NDArray[np.float64], across: NDArray[np.float64], rooms: list[RoomVolume]) -> tuple[str, ...]:
    """The ids of the rooms next to both sides, one if they are the same."""
    sides = (_room_ahead(centre, sign * across, rooms) for sign in (1.0, -1.0))
    return tuple(dict.fromkeys(room for room in sides if room is not None))


def _room_ahead(centre: NDArray[np.float64], direction: NDArray[np.float64], rooms: list[RoomVolume]) -> str | None:
    """The nearest room large enough to stand in, or the nearest."""
    path = shapely.LineString([centre, centre + REACH * direction])
    start = shapely.Point(centre)
    met = []
    for room in rooms:
        inside = overlap(path, room.area)
        if inside.length > 1e-3:
            met.append((inside.length < STANDING, start.distance(inside), room.room.id))
    return min(met)[2] if met else None
