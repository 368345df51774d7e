"""Floor plans of published sets, as JSON: `rooms` with GeoJSON polygons in metres, `elements` with walls, doors and
windows likewise.

{"name": ..., "unit": "m", "rooms": [{"name" or "type": ..., "polygon": {"type": "Polygon", "coordinates": ...}}],
 "elements": {"wall": [{"polygon": ...}], "door": [...], "entrance_door": [...], "window": [...], ...}}
"""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import shapely
import shapely.geometry

from data.common.errors import UserError, refusing
from data.geometry.areas import Area, polygons_of, united
from data.plans.flat_plan import HEIGHT, roomless_surfaces
from data.plans.polygons import DrawnRoom, Plan, scene_graph_of, with_pillars
from data.walls.rooms import Level, width_of

MIN_AREA = 1.0  # m2: below it, a shaft
DOOR_WIDTH = (0.5, 2.5)  # m: a plan whose doors are mostly wider or narrower is not in metres
OUTSIDE = ("balcony", "loggia", "veranda", "terrace", "patio", "garden", "outdoor", "parking")
NO_ROOM = ("shaft", "void", "ps", "pipe space", "structure", "lightwell", "elevator_shaft")
DOORS = ("door", "entrance_door", "sliding_door")
WALLS = ("wall", "railing", "column", "window")
DUPLICATE = 0.1  # m2: rooms of duplicates differ less
DUPLICATE_ROOMS = 4  # fewer rooms agree by chance


def is_room(kind: str, outside: bool = False) -> bool:
    """Whether a robot may enter a room of this kind: never shafts and voids, balconies only with `outside`."""
    word = kind.strip().lower().replace(" ", "_")
    if word in NO_ROOM or word.replace("_", " ") in NO_ROOM:
        return False
    return outside or not any(o in word for o in OUTSIDE)


def read_json_plan(text: str | bytes, where: str, merge_collinear: bool = True) -> Plan:
    """One plan; raises UserError, naming `where`, where the form is not kept or nothing is left to match.

    Balconies, shafts and rooms below `MIN_AREA` are left out; with `merge_collinear=False` (see `scene_graph_of`)
    shafts and voids alone, as in the published matcher's data.
    """
    with refusing(f"{where}: not a floor plan in JSON"):
        value = json.loads(text)
        rooms, doors, walls = _drawing(value, where, everything=not merge_collinear)
        name = str(value.get("name") or where)
        named = ((f"door{k}", door) for k, door in enumerate(doors))
        graph = scene_graph_of(rooms, named, walls, merge_collinear=merge_collinear)
        if merge_collinear and graph.wall_surfaces:
            outside = roomless_surfaces(walls, [*(r.area for r in rooms), *doors], Level(None, 0.0, HEIGHT))
            more = (replace(s, id=f"surface{k}", source="", height=None) for k, s in enumerate(outside))
            graph = replace(graph, wall_surfaces=(*graph.wall_surfaces, *more))
    if not graph.wall_surfaces:
        raise UserError(f"{where}: no room with walls; skip it, or draw its rooms as polygons")
    return Plan(name, str(value.get("building") or name), graph)


def _drawing(value: Any, where: str, everything: bool) -> tuple[list[DrawnRoom], list[Area], Area]:
    """Rooms, doors, and the area of walls, railings and windows."""
    if value.get("unit", "m") != "m":
        raise UserError(f"{where}: the unit is '{value['unit']}'; give the plan in metres ('m')")
    elements = value.get("elements") or {}
    doors = [_area(e) for kind in DOORS for e in elements.get(kind, ())]
    width = float(np.median([width_of(door) for door in doors])) if doors else sum(DOOR_WIDTH) / 2
    if not DOOR_WIDTH[0] <= width <= DOOR_WIDTH[1]:
        raise UserError(f"{where}: its doors are {width:.2g} m wide: the plan is not in metres; scale it")
    rooms = []
    for k, item in enumerate(value["rooms"]):
        kind = str(item.get("type") or item.get("name") or "")
        parts = shapely.get_parts(_area(item))
        for n, part in enumerate(parts):
            if is_room(kind, outside=everything) and (everything or part.area >= MIN_AREA):
                rooms.append(DrawnRoom(f"room{k}" + (f".{n}" if len(parts) > 1 else ""), part, kind))
    walls = united(_area(e) for kind in WALLS for e in elements.get(kind, ()))
    return rooms if everything else with_pillars(rooms, walls), doors, walls


def _area(item: dict[str, Any]) -> Area:
    shape = polygons_of(shapely.geometry.shape(item["polygon"]))
    if shape.is_empty or not np.isfinite(shape.bounds).all():
        raise ValueError("a polygon is empty or holds numbers that are not finite")
    return shape


class Buildings:
    """Recognises plans of one building: duplicates, whose rooms have equal areas, get the first one's building."""

    def __init__(self) -> None:
        self._seen: dict[int, list[tuple[np.ndarray, str]]] = {}

    def of(self, plan: Plan) -> str:
        """The building of the first plan with the same room areas, otherwise the plan's own."""
        areas = np.sort([shapely.Polygon(r.polygon).area for r in plan.graph.rooms if r.polygon is not None])
        if len(areas) < DUPLICATE_ROOMS:
            return plan.building
        same_count = self._seen.setdefault(len(areas), [])
        for other, building in same_count:
            if np.abs(other - areas).max() < DUPLICATE:
                return building
        same_count.append((areas, plan.building))
        return plan.building
