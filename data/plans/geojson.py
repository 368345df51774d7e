"""GeoJSON plans: rooms as polygons, walls as polygons or lines, doors; storeys, elevations and heights as properties.

Coordinates are metres, or degrees (RFC 7946) if their extent suggests it; these are converted to metres east and north
of the plan's middle. Properties say what a feature is (`type`, `kind`, `category`, `feature_type`, `indoor`, `layer`),
as in indoor maps of OpenStreetMap and IMDF; by default a polygon is a room and a line a wall.
"""

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import shapely
import shapely.geometry
from numpy.typing import NDArray

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


@dataclass
class _Storey:
    walls: list[Area] = field(default_factory=list)
    lines: list[NDArray[np.float64]] = field(default_factory=list)  # each (K, 2, 2)
    rooms: list[tuple[str, str, Area]] = field(default_factory=list)
    doors: list[Area] = field(default_factory=list)
    elevations: list[float] = field(default_factory=list)
    heights: list[float] = field(default_factory=list)


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


def plan_of(value: Any, where: str) -> tuple[SceneGraph, tuple[str, ...]]:
    """Returns the A-graph (frame "bim") of a feature collection, and notices.

    Raises UserError if it is none, its geometry is broken, its size is implausible, or it has no walls or rooms.
    """
    if not isinstance(value, dict) or value.get("type") not in ("FeatureCollection", "Feature"):
        raise UserError(f"{where}: not GeoJSON; give a FeatureCollection")
    features, notices = _in_metres(_features(value, where), where)
    storeys: dict[str, _Storey] = defaultdict(_Storey)
    for feature in features:
        _sort_in(storeys[feature.text(STOREY)], feature)
    with refusing(f"{where}: its geometry cannot be used"):
        flat = [_flat(name, storey) for name, storey in storeys.items() if storey.rooms or storey.walls or storey.lines]
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


def _sort_in(storey: _Storey, feature: _Feature) -> None:
    """Adds a feature to its storey, by what it is."""
    kinds = [str(feature.properties[n]).lower() for n in KIND if feature.properties.get(n) not in (None, "")]
    message = " ".join(kinds)
    kind = feature.shape.geom_type.removeprefix("Multi")
    storey.elevations += [z] if (z := feature.number(ELEVATION)) is not None else []
    storey.heights += [h] if (h := feature.number(HEIGHT)) is not None and h > 1.0 else []
    if any(word in message for word in DOOR) or ("door" in feature.properties and kind != "Polygon"):
        depth, cap = 0.0 if kind == "Polygon" else DOOR_DEPTH / 2, "flat" if kind == "LineString" else "square"
        storey.doors.append(polygons_of(feature.shape.buffer(depth, cap_style=cap)))
    elif kind == "Polygon":
        area = polygons_of(feature.shape)
        if any(word in message for word in WALL):
            storey.walls.append(area)
        elif not any(k in NO_PART for k in kinds) and is_room(kinds[-1] if kinds else ""):
            storey.rooms.append((feature.id, feature.text(("name", "label", "room", "number")), area))
    elif kind == "LineString" and not any(k in NO_PART for k in kinds):
        thickness = feature.number(THICKNESS)
        if thickness is not None and 0.0 < thickness < 2.0:
            storey.walls.append(polygons_of(feature.shape.buffer(thickness / 2, cap_style="flat", join_style="mitre")))
        else:
            for line in shapely.get_parts(feature.shape):
                points = np.asarray(line.coords)
                storey.lines.append(np.stack([points[:-1], points[1:]], axis=1))


def _flat(name: str, storey: _Storey) -> FlatStorey:
    segments = np.concatenate([np.empty((0, 2, 2)), *storey.lines])
    segments = segments[np.any(segments[:, 0] != segments[:, 1], axis=1)]
    walls = walls_of_lines(segments, storey.walls).area
    ids: dict[str, int] = defaultdict(int)
    rooms = []
    for id, label, area in storey.rooms:
        if not area.is_empty:
            ids[id] += 1
            rooms.append((id if ids[id] == 1 else f"{id}~{ids[id]}", label, area))
    doors = [d for d in storey.doors if not d.is_empty]
    elevation = float(np.median(storey.elevations)) if storey.elevations else None
    height = float(np.median(storey.heights)) if storey.heights else None
    is_level = all(max(z) - min(z) < SAME_HEIGHT for z in (storey.elevations, storey.heights) if z)
    return FlatStorey(name, united([walls]), rooms, doors, elevation, height, is_level)
