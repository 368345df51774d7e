"""Floor plans of published sets: as JSON with polygons in metres, and Modified Swiss Dwellings' table of polygons.

JSON: `rooms` with GeoJSON polygons, `elements` with walls, doors and windows likewise.

{"name": ..., "unit": "m", "rooms": [{"name" or "type": ..., "polygon": {"type": "Polygon", "coordinates": ...}}],
 "elements": {"wall": [{"polygon": ...}], "door": [...], "entrance_door": [...], "window": [...], ...}}

MSD (van Engelenburg et al., "MSD: A Benchmark Dataset for Floor Plan Generation of Building Complexes", ECCV 2024) is
CSV with WKT. Both published tables (`MSD 5.664k (V1).csv`, `mds_V2_5.372k.csv`) and the table that they were made from
(Swiss Dwellings' `geometries.csv`) have the columns that are read here; others are ignored.
"""

import csv
import json
import logging
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import shapely
import shapely.geometry

from data.common.errors import UserError, refusing
from data.geometry.areas import Area, polygons_of, united
from data.plans.flat_plan import HEIGHT, roomless_surfaces
from data.plans.polygons import Drawing, DrawnRoom, Plan, scene_graph_of, with_pillars
from data.scene_graph import Floor, WallSurface
from data.walls.rooms import Level, width_of

MIN_AREA = 1.0  # m2: below it, a shaft
DOOR_WIDTH = (0.5, 2.5)  # m: a plan whose doors are mostly wider or narrower is not in metres
OUTSIDE = ("balcony", "loggia", "veranda", "terrace", "patio", "garden", "outdoor", "parking")
NO_ROOM = ("shaft", "void", "ps", "pipe space", "structure", "lightwell", "elevator_shaft")
DOORS = ("door", "entrance_door", "sliding_door")
WALLS = ("wall", "railing", "column", "window")
DUPLICATE = 0.1  # m2: rooms of duplicates differ less
DUPLICATE_ROOMS = 4  # fewer rooms agree by chance
GEOMETRY = ("geom", "geometry")
BUILDING = ("site_id", "building_id", "plan_id", "floor_id")  # a site's buildings are often alike: they stay together
NO_AREA = ("structure", "door", "entrance door", "window", "wall", "railing", "column")
_log = logging.getLogger(__name__)
LARGEST_FIELD = 10_000_000  # characters


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
        drawing = _drawing(value, where, everything=not merge_collinear)
        name = str(value.get("name") or where)
        graph = scene_graph_of(drawing, merge_collinear)
        if merge_collinear and graph.wall_surfaces:
            graph = replace(graph, wall_surfaces=(*graph.wall_surfaces, *_roomless(drawing)))
    if not graph.wall_surfaces:
        raise UserError(f"{where}: no room with walls; skip it, or draw its rooms as polygons")
    return Plan(name, str(value.get("building") or name), graph)


def _roomless(drawing: Drawing) -> list[WallSurface]:
    others = [*(r.area for r in drawing.rooms), *(area for _, area, _ in drawing.doors)]
    outside = roomless_surfaces(drawing.walls, others, Level(None, 0.0, HEIGHT))
    return [replace(s, id=f"surface{k}", source="", height=None) for k, s in enumerate(outside)]


def _drawing(value: Any, where: str, everything: bool) -> Drawing:
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
    rooms = rooms if everything else with_pillars(rooms, walls)
    return Drawing(rooms, [(f"door{k}", door, None) for k, door in enumerate(doors)], walls)


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


Row = dict[str, str]


def read_msd(path: Path, merge_collinear: bool = True) -> Iterator[Plan]:
    """The table's apartments in the order in which they first appear; the rows of a plan may lie anywhere in it.

    An apartment on several floors has several floors in its graph; ids of floors are the table's. `merge_collinear`:
    see `scene_graph_of`; without it shafts, small rooms and balconies are rooms, as in the published matcher's data.

    Rows without a usable polygon and plans without rooms are left out and counted in the log. Raises UserError for a
    file that is not such a table.
    """
    apartments, fixed = defaultdict[str, list[Row]](list), defaultdict[str, list[Row]](list)
    skipped, without_rooms = Counter[str](), 0
    for row in _rows(path, skipped):
        if row["roomtype"].strip().lower() in NO_AREA:
            fixed[row["floor_id"]].append(row)
        elif row["apartment_id"] and row["floor_id"]:
            apartments[_id(row["apartment_id"])].append(row)
    for key, rows in apartments.items():
        around = [row for floor in dict.fromkeys(r["floor_id"] for r in rows) for row in fixed[floor]]
        graph = scene_graph_of(_apartment(rows, around, not merge_collinear, skipped), merge_collinear)
        if not graph.wall_surfaces:
            without_rooms += 1
            continue
        building = next((f"{c[:-3]} {_id(rows[0][c])}" for c in BUILDING if rows[0].get(c)), key)
        yield Plan(f"apartment {key}", building, graph)
    if without_rooms:
        _log.warning(f"{path}: skipped {without_rooms} of {len(apartments)} plans: no room with walls")
    for why, count in skipped.items():
        _log.warning(f"{path}: skipped {count} rows: {why}")


def _rows(path: Path, skipped: Counter[str]) -> Iterator[Row]:
    csv.field_size_limit(LARGEST_FIELD)
    with refusing(f"{path}: not a CSV table in UTF-8"), path.open(encoding="utf-8-sig", newline="") as file:
        table = csv.DictReader(file)
        header = table.fieldnames or ()
        lacking = [c for c in ("floor_id", "apartment_id", "roomtype") if c not in header]
        if lacking or not any(c in header for c in GEOMETRY):
            raise UserError(f"{path}: not Modified Swiss Dwellings: no column {', '.join(lacking) or GEOMETRY[0]}")
        for row in table:
            if None in row or None in row.values():
                skipped["not as many columns as the header has"] += 1
            else:
                yield row


def _id(value: str) -> str:
    """Ids without the `.0` that a table with gaps adds to integers."""
    return value[:-2] if value.endswith(".0") else value


def _apartment(rows: list[Row], fixed: list[Row], everything: bool, skipped: Counter[str]) -> Drawing:
    rooms: list[DrawnRoom] = []
    floors: dict[str, Floor] = {}
    for k, row in enumerate(rows):
        kind, floor = row["roomtype"].strip(), _id(row["floor_id"])
        known = [row.get("entity_subtype", ""), kind]
        if row.get("entity_type", "area") not in ("area", "") or not all(
            is_room(word, outside=everything) for word in known
        ):
            continue
        low, tall = _number(row.get("elevation")), _number(row.get("height"))
        height = (low, low + tall) if low is not None and tall else None
        for n, part in enumerate(_polygons(row, skipped)):
            if everything or part.area >= MIN_AREA:
                rooms.append(DrawnRoom(f"room{k}" + (f".{n}" if n else ""), part, kind, floor, height))
                floors.setdefault(floor, Floor(floor, f"Floor {floor}", low))
    doors, walls = [], []
    around = shapely.MultiPolygon([r.area for r in rooms]).envelope.buffer(1.0)
    for k, row in enumerate(fixed):
        parts = [p for p in _polygons(row, skipped) if p.intersects(around)]
        if "door" in row["roomtype"].lower():
            doors += [(f"door{k}", part, _id(row["floor_id"])) for part in parts]
        else:
            walls += parts
    return Drawing(rooms, doors, united(walls), tuple(floors.values()))


def _polygons(row: Row, skipped: Counter[str]) -> list[Area]:
    text = next(row[c] for c in GEOMETRY if c in row)
    try:
        shape = shapely.from_wkt(text)
    except (shapely.errors.ShapelyError, TypeError):
        skipped["the polygon is not WKT"] += 1
        return []
    area = polygons_of(shape) if shape is not None and np.isfinite(shape.bounds).all() else shapely.Polygon()
    if area.is_empty:
        skipped["no area, or numbers that are not finite"] += 1
    return [p for p in shapely.get_parts(area) if p.area > 0]


def _number(text: str | None) -> float | None:
    try:
        value = float(text or "nan")
    except ValueError:
        return None
    return value if np.isfinite(value) else None
