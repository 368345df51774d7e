"""Rooms of an IFC model without spaces: the closed faces between the walls of a level, doors and windows shut."""

from collections.abc import Iterable
from dataclasses import replace

import ifcopenshell
import numpy as np
import shapely

from data.areas import Area, closed, difference, enclosed, opened, overlap, polygons_of, united
from data.ifc_doors import across, body_of
from data.ifc_products import products
from data.ifc_rooms import Level, RoomVolume, finished
from data.ifc_sections import Solid, solid_of
from data.ifc_surfaces import CUTS
from data.scene_graph import Room

FILLINGS = ("IfcDoor", "IfcWindow")
HEAD = 1.0  # m above the level: what stands there is a wall of the level
GAP = 0.3  # m: walls this close to each other meet
DOORWAY = 1.2  # m: a wider opening in a wall that no door fills joins what lies on its sides
INDOORS = 6.0  # m: what lies between walls this close to each other is part of the building
MIN_AREA = 1.5  # m2: below it, a shaft
HALF_WIDTH = 0.3  # m: a face that is nowhere twice as wide is a cavity
MIN_OPEN = 2.0  # m2: of what lies indoors and in no room


def rooms_between(model: ifcopenshell.file, levels: list[Level], walls: list[Solid]) -> list[Level]:
    """The levels, those that have closed faces between their walls with these as rooms.

    Where it has rooms, a level's `unknown` area is what else lies indoors. Columns count as parts of walls;
    gaps up to GAP and openings with a door or window, or up to DOORWAY, count as closed. Room ids are the
    storey's GlobalId and a number by position.
    """
    solids = [*walls, *(solid_of(p) for p in products(model, ("IfcColumn",)))]
    fillings = [f for f in map(_filling, (f for c in FILLINGS for f in model.by_type(c))) if f is not None]
    return [_with_rooms(level, solids, fillings) for level in levels]


Filling = tuple[Area, float, float, float]  # rectangle in plan, width, lower and upper z


def _filling(element: ifcopenshell.entity_instance) -> Filling | None:
    vertices, _ = body_of(element)
    if vertices is None:
        return None
    through = across(element)
    axes = np.array([[through[1], -through[0]], through])
    low, high = (f(vertices[:, :2] @ axes.T, axis=0) for f in (np.min, np.max))
    corners = np.array([low, (high[0], low[1]), high, (low[0], high[1])]) @ axes
    # Placed askew, the width may be the other side.
    width = float((high - low).max())
    return shapely.Polygon(corners), width, float(vertices[:, 2].min()), float(vertices[:, 2].max())


def _with_rooms(level: Level, solids: list[Solid], fillings: list[Filling]) -> Level:
    walls = _shut_walls(level.bottom, solids, fillings)
    faces = [f for f in enclosed(walls) if f.area >= MIN_AREA and opened(f, HALF_WIDTH).area >= MIN_AREA]
    faces.sort(key=lambda f: (round(f.centroid.x, 2), round(f.centroid.y, 2)))
    if not faces:
        return level
    prefix = level.floor or f"level {level.bottom:.2f}"
    rooms = tuple(
        finished(RoomVolume(Room(f"{prefix}/room-{k}", (0.0, 0.0), level.floor, f"Room {k}"), face, level.bottom, top))
        for k, (face, top) in enumerate(((f, level.top) for f in faces), start=1)
    )
    outlines = united(shapely.Polygon(p.exterior) for p in shapely.get_parts(closed(walls, INDOORS)))
    rest = opened(difference(difference(outlines, walls), united(faces)), HALF_WIDTH)
    unknown = shapely.MultiPolygon([p for p in shapely.get_parts(rest) if p.area > MIN_OPEN])
    return replace(level, rooms=rooms, unknown=unknown)


def _shut_walls(z: float, solids: list[Solid], fillings: list[Filling]) -> Area:
    """The walls that stand at the level of `z`, with what is closed between and in them."""
    standing = [s for s in solids if s.bottom < z + HEAD < s.top]
    parts = []
    for solid in standing:
        body = united(solid.section(z + height) for height in CUTS)
        parts += [body, *_doorways(difference(solid.shadow(), body))]
    walls = united(parts)
    shut = (_shut(walls, area, width) for area, width, low, high in fillings if low < z + HEAD < high)
    return closed(united([walls, *shut]), GAP)


def _doorways(openings: Area) -> Iterable[Area]:
    """The openings under a lintel that are no wider than a doorway."""
    for part in shapely.get_parts(openings):
        corners = np.asarray(shapely.oriented_envelope(part).exterior.coords) if part.area > 0 else np.zeros((5, 2))
        if np.linalg.norm(np.diff(corners, axis=0), axis=1).max() <= DOORWAY:
            yield part


def _shut(walls: Area, filling: Area, width: float) -> Area:
    """The part of a door's or window's area that lies between the walls on its sides."""
    around = filling.buffer(width + GAP).bounds
    near = polygons_of(shapely.clip_by_rect(walls, *around))
    return polygons_of(overlap(filling, closed(near, width + GAP)))
