"""Rooms of an IFC model: the footprints of its spaces, without those that a robot cannot enter."""

from dataclasses import replace

import ifcopenshell
import shapely
from shapely.geometry.polygon import orient

from data.geometry.areas import Area, difference, largest, overlap, polygons_of, united
from data.ifc.products import solids
from data.scene_graph import Room
from data.walls.rooms import RoomVolume, finished

MIN_AREA = 1.0  # m2: below it, a shaft
MIN_HEIGHT = 1.3  # m: below it, a void over a ceiling or under a floor
SAME = 0.9  # of an area: inside, or the same
WALL_HALF = 0.25  # m: what is left of a covering space between its rooms is no wider than a wall
SHOWN = 3  # names of spaces that are left out for one reason
TIDY = 0.001  # m: corners that stand out less are no corners


def rooms_of(model: ifcopenshell.file) -> tuple[list[RoomVolume], list[str]]:
    """Returns the rooms, and one-line notices on spaces that are left out.

    Left out are outer and gross spaces, spaces that only cover other rooms, duplicates, shafts and voids. A space
    within another is a room and is cut out of the other.
    """
    spaces = model.by_type("IfcSpace")
    chosen = {s.GlobalId: s for s in spaces if _is_room(s)}
    volumes: list[RoomVolume] = []
    for solid in solids(model, ("IfcSpace",)):
        if solid.id in chosen and solid.id not in {v.room.id for v in volumes}:
            area = _tidy(solid.shadow())
            room = Room(solid.id, (0.0, 0.0), solid.storey, _name(chosen[solid.id]))
            volumes.append(RoomVolume(room, area, solid.bottom, solid.top))
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
        within = [k for k in kept if k.beside(volume) and _inside(k.area, volume.area)]
        rest = difference(volume.area, united(k.area for k in within))
        open_rest = rest.buffer(-WALL_HALF)
        if within and open_rest.area < max(MIN_AREA, (1 - SAME) * volume.area.area):
            continue
        kept.append(replace(volume, area=_tidy(rest)) if within else volume)
    return kept


def _inside(small: Area, large: Area) -> bool:
    return bool(overlap(small, large).area > SAME * small.area)
