"""Doors of an IFC model and the rooms that they join; in a model without spaces, the rooms between its walls.

These are the closed faces between the walls of a level, with doors and windows closed.
"""

from dataclasses import dataclass, replace

import ifcopenshell
import ifcopenshell.util.placement
import numpy as np
import shapely
from numpy.typing import NDArray

from data.geometry.areas import Area, closed, difference, overlap, polygons_of, united
from data.ifc.products import opening_of, triangulated
from data.scene_graph import Door
from data.walls.rooms import GAP, STOREY, Level, RoomVolume, closed_faces, doorways, halls, open_area, rooms_of_faces
from data.walls.solids import Solid
from data.walls.surfaces import CUTS

REACH = 1.0  # m: a room begins this close to the middle of a door
STANDING = 0.3  # m of a room in front of a door, enough to stand in it
ABOVE_SILL = 0.5  # m
FILLINGS = ("IfcDoor", "IfcWindow")
HEAD = 1.0  # m above the level: what stands there is a wall of the level
BEGINS = 0.5  # m: what begins this close to a level belongs to it
SAME = 0.7  # of the larger one's area: the same face


def doors_of(model: ifcopenshell.file, rooms: list[RoomVolume], walls: dict[str, Area]) -> tuple[Door, ...]:
    """Returns every IfcDoor with a position; `walls` are the walls' areas in plan by GlobalId.

    It is in the middle of the opening in its wall, since a door's own shape may include an open leaf.
    """
    tree, found = shapely.STRtree([room.area for room in rooms]), []
    for global_id, door in {door.GlobalId: door for door in model.by_type("IfcDoor")}.items():
        vertices, host = body_of(door)
        if vertices is None:
            continue
        through = across(door)
        centre = _middle(vertices[:, :2], through)
        hull = shapely.MultiPoint(vertices[:, :2]).convex_hull
        within = polygons_of(overlap(hull, walls[host])) if host in walls else shapely.Polygon()
        if not within.is_empty:
            centre = _middle(np.asarray(shapely.get_coordinates(within)), through)
        x, y = centre.tolist()
        near = sorted(tree.query(shapely.box(x - REACH, y - REACH, x + REACH, y + REACH)).tolist())
        z = float(vertices[:, 2].min()) + ABOVE_SILL
        here = [rooms[k] for k in near if rooms[k].bottom < z < rooms[k].top]
        along = np.array([-through[1], through[0]])
        joined = _rooms_beside(centre, through, here) or _rooms_beside(centre, along, here)
        found.append(Door(global_id, joined, (x, y)))
    return tuple(found)


def body_of(filling: ifcopenshell.entity_instance) -> tuple[NDArray[np.float64] | None, str | None]:
    """Vertices (N, 3) of the opening that a door or window fills, or of itself, and the GlobalId of the wall."""
    opening, host = opening_of(filling)
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


@dataclass(frozen=True)
class Filling:
    """A door or window: its rectangle in plan, the same with what lies on its `sides`, its width, and its z range."""

    area: Area
    sides: Area
    width: float
    low: float
    high: float
    is_door: bool


@dataclass(frozen=True, eq=False)
class Face:
    """A closed face between walls at one level.

    `doors` and `walls` measure what bounds it and begins there: the number of doors, and the area of walls in m2.
    """

    area: Area
    level: Level
    doors: int
    walls: float


def rooms_between(model: ifcopenshell.file, levels: list[Level], solids: list[Solid]) -> list[Level]:
    """The levels, those that have closed faces between their walls with these as rooms.

    `solids` are the walls and columns. Gaps up to GAP and openings with a door or window, or no wider than a doorway,
    count as closed. Of the same face at levels too close to each other for two storeys (split levels), the one is kept
    where its doors, else its walls, begin. Room ids are the storey's GlobalId and a number by position.
    """
    fillings = [f for f in map(_filling, (f for c in FILLINGS for f in model.by_type(c))) if f is not None]
    shut = [_shut_walls(level.bottom, solids, fillings) for level in levels]
    faces = [_faces(level, area, solids, fillings) for level, area in zip(levels, shut, strict=True)]
    kept = _of_one_level([f for here in faces for f in here])
    result = []
    for level, area, here in zip(levels, shut, faces, strict=True):
        rooms = _rooms(level, [f for f in here if f in kept], levels)
        result.append(replace(level, rooms=rooms, open=open_area(area, [f.area for f in here])))
    return result


def _filling(element: ifcopenshell.entity_instance) -> Filling | None:
    vertices, _ = body_of(element)
    if vertices is None:
        return None
    through = across(element)
    axes = np.array([[through[1], -through[0]], through])
    low, high = (f(vertices[:, :2] @ axes.T, axis=0) for f in (np.min, np.max))
    margin = GAP * (np.arange(2) == np.argmin(high - low))  # the broad sides, however it was placed
    area, sides = (_rectangle(low - m, high + m, axes) for m in (0.0, margin))
    z = vertices[:, 2]
    return Filling(area, sides, float((high - low).max()), float(z.min()), float(z.max()), element.is_a("IfcDoor"))


def _rectangle(low: NDArray[np.float64], high: NDArray[np.float64], axes: NDArray[np.float64]) -> Area:
    return shapely.Polygon(np.array([low, (high[0], low[1]), high, (low[0], high[1])]) @ axes)


def _faces(level: Level, walls: Area, solids: list[Solid], fillings: list[Filling]) -> list[Face]:
    """The closed faces, by position, and the halls that are open at gates."""
    areas = closed_faces(walls)
    areas += halls(walls, areas)[0]
    doors = [f.sides for f in fillings if f.is_door and abs(f.low - level.bottom) < BEGINS]
    begun = united(s.shadow() for s in solids if abs(s.bottom - level.bottom) < BEGINS) if areas else walls
    return [
        Face(area, level, sum(d.intersects(area) for d in doors), overlap(area.buffer(GAP), begun).area)
        for area in areas
    ]


def _of_one_level(faces: list[Face]) -> list[Face]:
    kept: list[Face] = []
    for face in sorted(faces, key=lambda f: (-f.doors, -round(f.walls, 2), f.level.bottom)):
        near = (k for k in kept if 0 < abs(k.level.bottom - face.level.bottom) < STOREY)
        if not any(overlap(k.area, face.area).area > SAME * max(k.area.area, face.area.area) for k in near):
            kept.append(face)
    return kept


def _rooms(level: Level, faces: list[Face], levels: list[Level]) -> tuple[RoomVolume, ...]:
    """Each from the level up to the next one that a storey fits under."""
    top = next((above.bottom for above in levels if above.bottom >= level.bottom + STOREY), levels[-1].top)
    key = level.floor or f"level {level.bottom:.2f}"
    return rooms_of_faces((face.area for face in faces), key, level.floor, level.bottom, top)


def _shut_walls(z: float, solids: list[Solid], fillings: list[Filling]) -> Area:
    """The walls that stand at the level of `z`, with what is closed between and in them."""
    standing = [s for s in solids if s.bottom < z + HEAD < s.top]
    parts = []
    for solid in standing:
        body = united(solid.section(z + height) for height in CUTS)
        parts += [body, *doorways(difference(solid.shadow(), body))]
    walls = united(parts)
    shut = (_shut(walls, f) for f in fillings if f.low < z + HEAD < f.high)
    return closed(united([walls, *shut]), GAP)


def _shut(walls: Area, filling: Filling) -> Area:
    """The part of a door's or window's area that lies between the walls on its sides."""
    around = filling.area.buffer(filling.width + GAP).bounds
    near = polygons_of(shapely.clip_by_rect(walls, *around))
    return polygons_of(overlap(filling.area, closed(near, filling.width + GAP)))
