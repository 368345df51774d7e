"""GeoJSON plans: rooms as polygons, walls as polygons or lines, doors; storeys, elevations and heights as properties.

Coordinates are metres, or degrees (RFC 7946) if their extent suggests it; these are converted to metres east and north
of the plan's middle. Properties say what a feature is (`type`, `kind`, `category`, `feature_type`, `indoor`, `layer`),
as in indoor maps of OpenStreetMap and IMDF; by default a polygon is a room and a line a wall.
"""

import math
from collections import Counter, defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely
import shapely.geometry

from data.common.errors import UserError, refusing
from data.geometry.areas import Area, polygons_of, united
from data.plans.flat_plan import FlatStorey, graph_of_storeys, walls_of_lines
from data.plans.published_plans import is_room
from data.scene_graph import SceneGraph

KIND = ("type", "kind", "category", "class", "feature_type", "featuretype", "indoor", "layer", "element", "ifc_class")
STOREY = ("storey", "story", "floor", "level", "level_id", "floor_id", "storey_id", "geschoss", "etage")
ELEVATION = ("elevation", "floor_elevation", "base_elevation", "base", "z")
HEIGHT = ("height", "ceiling_height", "room_height", "storey_height")
THICKNESS = ("thickness", "width")
WALL, DOOR = ("wall", "window", "column", "pillar", "partition"), ("door", "opening", "entrance", "gate")
NO_PART = ("venue", "building", "footprint", "level", "site", "outline", "storey", "floor")  # what holds rooms
SMALLEST_METRES, LARGEST = 0.5, 20_000.0  # extents: below the one it is degrees, over the other no building
DOOR_DEPTH = 0.4  # m: of a door drawn as a line or point
SAME_HEIGHT = 0.01  # m
EARTH = 6_378_137.0  # m


@dataclass(frozen=True)
class _Feature:
    shape: Any  # a shapely geometry, metres
    properties: dict[str, Any]
    id: str

    def text(self, names: Sequence[str]) -> str:
        """The first of these properties that is set."""
        return next((str(self.properties[n]) for n in names if self.properties.get(n) not in (None, "")), "")

    def number(self, names: Sequence[str]) -> float | None:
        """The first of these properties that is a finite number of a building's size."""
        for name in names:
            try:
                value = float(self.properties[name])
            except (KeyError, TypeError, ValueError, OverflowError):
                continue
            if abs(value) < LARGEST:
                return value
        return None


def plan_of(value: dict[str, Any], where: str) -> tuple[SceneGraph, tuple[str, ...]]:
    """Returns the A-graph (frame "bim") of a feature collection, and notices.

    Raises UserError if it is none, its geometry is broken, its size is implausible, or it has no walls or rooms.
    """
    if value.get("type") not in ("FeatureCollection", "Feature"):
        raise UserError(f"{where}: not GeoJSON; give a FeatureCollection")
    features, notices = _in_metres(_features(value, where), where)
    storeys = defaultdict[str, list[_Feature]](list)
    for feature in features:
        storeys[feature.text(STOREY)].append(feature)
    with refusing(f"{where}: its geometry cannot be used"):
        flat = [_storey(name, own) for name, own in storeys.items()]
        flat = [storey for storey in flat if storey.rooms or not storey.walls.is_empty]
        flat.sort(key=lambda s: (s.elevation is None, s.elevation or 0.0, s.name))
        graph, made = graph_of_storeys(flat, where)
    if len(flat) > 1 and any(s.elevation is None for s in flat):
        notices.append("some of the storeys have no elevation; z = 0 is assumed for these")
    return graph, (*notices, *made)


def _features(value: dict[str, Any], where: str) -> list[_Feature]:
    items = value.get("features") if value["type"] == "FeatureCollection" else [value]
    found = []
    for number, item in enumerate(items if isinstance(items, list) else []):
        if not isinstance(item, dict) or not isinstance(item.get("geometry"), dict):
            continue
        with refusing(f"{where}, feature {number}: a broken geometry"):
            shape = shapely.force_2d(shapely.geometry.shape(item["geometry"]))
        if not shape.is_empty:
            if not np.isfinite(shape.bounds).all():
                raise UserError(f"{where}, feature {number}: a coordinate is not finite")
            properties = item.get("properties")
            named = properties if isinstance(properties, dict) else {}
            lowered = {str(k).lower(): v for k, v in {**item, **named}.items() if k not in ("geometry", "properties")}
            if "type" not in {str(k).lower() for k in named}:
                lowered.pop("type", None)  # it says "Feature"
            found.append(_Feature(shape, lowered, str(item.get("id", number))))
    if not found:
        raise UserError(f"{where}: no features with a geometry; give a plan with rooms or walls")
    return found


def _in_metres(features: list[_Feature], where: str) -> tuple[list[_Feature], list[str]]:
    low_x, low_y, high_x, high_y = shapely.total_bounds([f.shape for f in features]).tolist()
    extent = max(high_x - low_x, high_y - low_y)
    if extent >= SMALLEST_METRES:
        if extent > LARGEST:
            raise UserError(f"{where}: extends over {extent:g} m; give a building's plan in metres or degrees")
        return features, []
    lon, lat = (low_x + high_x) / 2, (low_y + high_y) / 2
    if not (abs(lon) <= 180 and abs(lat) < 89) or extent * math.radians(1) * EARTH < 2.0:
        raise UserError(f"{where}: extends over {extent:g} units, not a building's size; give metres or degrees")
    turn = math.radians(1) * EARTH
    factors = np.array([turn * math.cos(math.radians(lat)), turn])
    moved = shapely.transform([f.shape for f in features], lambda xy: (xy - [lon, lat]) * factors)
    message = f"degrees were converted to metres east (x) and north (y) of longitude {lon:.7f}, latitude {lat:.7f}"
    return [_Feature(m, f.properties, f.id) for f, m in zip(features, moved, strict=True)], [message]


def _storey(name: str, features: Sequence[_Feature]) -> FlatStorey:
    """The features of a storey, sorted by what they are."""
    walls, doors, lines = list[Area](), list[Area](), [np.empty((0, 2, 2))]
    rooms, ids = list[tuple[str, str, Area]](), Counter[str]()
    for feature in features:
        kinds = [str(feature.properties[n]).lower() for n in KIND if feature.properties.get(n) not in (None, "")]
        message, holds_rooms = " ".join(kinds), any(k in NO_PART for k in kinds)
        shape, kind = feature.shape, feature.shape.geom_type.removeprefix("Multi")
        if any(word in message for word in DOOR) or ("door" in feature.properties and kind != "Polygon"):
            depth, cap = 0.0 if kind == "Polygon" else DOOR_DEPTH / 2, "flat" if kind == "LineString" else "square"
            doors.append(polygons_of(shape.buffer(depth, cap_style=cap)))
        elif kind == "Polygon" and any(word in message for word in WALL):
            walls.append(polygons_of(shape))
        elif kind == "Polygon" and not holds_rooms and is_room(kinds[-1] if kinds else ""):
            ids[feature.id] += 1
            id = feature.id if ids[feature.id] == 1 else f"{feature.id}~{ids[feature.id]}"
            rooms.append((id, feature.text(("name", "label", "room", "number")), polygons_of(shape)))
        elif kind == "LineString" and not holds_rooms:
            thickness = feature.number(THICKNESS)
            if thickness is not None and 0.0 < thickness < 2.0:
                walls.append(polygons_of(shape.buffer(thickness / 2, cap_style="flat", join_style="mitre")))
            else:
                ends = [np.asarray(line.coords) for line in shapely.get_parts(shape)]
                lines += [np.stack([points[:-1], points[1:]], axis=1) for points in ends]
    segments = np.concatenate(lines)
    segments = segments[np.any(segments[:, 0] != segments[:, 1], axis=1)]
    elevations = [z for feature in features if (z := feature.number(ELEVATION)) is not None]
    heights = [h for feature in features if (h := feature.number(HEIGHT)) is not None and h > 1.0]
    return FlatStorey(
        name,
        united([walls_of_lines(segments, walls).area]),
        [room for room in rooms if not room[2].is_empty],
        [door for door in doors if not door.is_empty],
        float(np.median(elevations)) if elevations else None,
        float(np.median(heights)) if heights else None,
        all(max(z) - min(z) < SAME_HEIGHT for z in (elevations, heights) if z),
    )
