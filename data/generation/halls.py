"""Halls: parking decks, open-plan offices and warehouses, whose walls and columns hardly close a room.

The same kind and seed give the same hall. Its mesh can be driven through; its plan has only walls and columns, with
open gates and doors, and as IFC the two rooms of its core; it lacks the hall as a room and what stands around.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely
import shapely.geometry

from data.common.files import write_json
from data.generation.plan_mesh import LINTEL, SLAB, extruded
from data.geometry.areas import Area, difference, united
from data.ifc.writer import IfcWriter, Prism
from data.walls.rooms import closed_faces

Rng = np.random.Generator
KINDS = ("parking", "office", "warehouse")
SIZES = {"parking": (50.0, 60.0), "office": (32.0, 22.0), "warehouse": (40.0, 28.0)}  # m
HEIGHTS = {"parking": 2.8, "office": 2.9, "warehouse": 6.0}  # m
SPACINGS = {"parking": (7.5, 8.2), "office": (5.4, 6.6), "warehouse": (8.0, 14.0)}  # m between columns
GATES = {"parking": (2, 4.0, 5.5), "office": (1, 1.8, 2.2), "warehouse": (4, 3.0, 4.5)}  # number, least and most width
CLUTTER = {"parking": (4.5, 1.8, 1.5), "office": (1.6, 0.8, 0.75), "warehouse": (9.0, 1.1, 4.0)}  # cars, desks, racks
STANDING = 0.6  # of the places between columns, those that are taken
OUTER, INNER = 0.3, 0.15  # m, thickness of walls
DOOR, LANE = 0.95, 2.5  # m: width of a door; from walls to where things stand
WALL, COLUMN = "IfcWall", "IfcColumn"


@dataclass(frozen=True, eq=False)
class Hall:
    """Areas in plan (metres): walls and columns as built and planned, and `clutter` with its height, which is not."""

    name: str
    size: tuple[float, float]
    height: float
    walls: Area
    doorways: Area  # under a lintel, part of no wall below it
    columns: tuple[Area, ...]
    rooms: tuple[Area, ...]  # of the core
    clutter: tuple[Area, ...]
    clutter_height: float


def generate_hall(kind: str, seed: int) -> Hall:
    """A hall of one of `KINDS`; raises ValueError for an unknown one."""
    rng = np.random.default_rng([KINDS.index(kind), seed, 7])
    x, y = (side * float(rng.uniform(0.9, 1.1)) for side in SIZES[kind])
    outer = shapely.box(0, 0, x, y)
    gates = _gates(x, y, GATES[kind], rng)
    core, doorways = _core(x, y, rng)
    ring = difference(difference(outer, outer.buffer(-OUTER, join_style="mitre")), united(gates))
    piers = [_pier(x, y, rng) for _ in range(int(rng.integers(2, 5)))]
    walls = difference(united([ring, core, *(p for p in piers if not p.intersects(core))]), doorways)
    spacing, side = rng.uniform(*SPACINGS[kind], 2), float(rng.uniform(0.35, 0.6))
    us, vs = (np.arange(step, long - 2, step) for step, long in zip(spacing, (x, y), strict=True))
    places = [(u, v) for u in us for v in vs]
    clear = walls.buffer(LANE / 2)
    columns = [c for p in places if not (c := shapely.Point(p).buffer(side / 2, cap_style="square")).intersects(clear)]
    rooms = [r for r in closed_faces(united([walls, doorways, *gates])) if r.area < x * y / 4]
    clutter = _clutter(kind, spacing, [*columns, *rooms, clear, doorways.buffer(LANE)], (x, y), rng)
    fixed = (f"{kind}_{seed}", (x, y), HEIGHTS[kind], walls, doorways, tuple(columns), tuple(rooms))
    return Hall(*fixed, clutter, CLUTTER[kind][2])


def _gates(x: float, y: float, of: tuple[int, float, float], rng: Rng) -> list[Area]:
    """Openings in the outer walls, anywhere in a side but one in each part of it."""
    count, least, most = of
    found = []
    for k in range(count):
        width, share = float(rng.uniform(least, most)), float(rng.uniform(0.15, 0.85))
        along_x = count != 2 or k == 0
        free = (x if along_x else y) - most
        begin = share * free if count <= 2 else (k + share) / count * (free - (count - 1) * most) + k * most
        low, high = ((begin, -1.0), (begin + width, 1.0)) if along_x else ((-1.0, begin), (1.0, begin + width))
        found.append(shapely.box(*low, *high))
    return found


def _core(x: float, y: float, rng: Rng) -> tuple[Area, Area]:
    """The walls of two rooms at the outer wall opposite the first gate, and their doorways."""
    width, depth = float(rng.uniform(6.0, 10.0)), float(rng.uniform(3.5, 5.5))
    at = float(rng.uniform(0.1, 0.9)) * (x - width)
    box, middle = shapely.box(at, y - depth, at + width, y), at + width * float(rng.uniform(0.35, 0.65))
    rooms = shapely.box(at + INNER, y - depth + INNER, at + width - INNER, y)
    between = shapely.box(middle, y - depth, middle + INNER, y)
    doors = [
        shapely.box(u, y - depth - 0.05, u + DOOR, y - depth + INNER + 0.05)
        for u in (float(rng.uniform(at + 0.4, middle - DOOR - 0.3)), float(rng.uniform(middle + 0.5, at + width - 1.5)))
    ]
    return united([difference(box, rooms), between]), united(doors)


def _pier(x: float, y: float, rng: Rng) -> Area:
    """A wall that stands free in the hall or leans on an outer one."""
    length, u, v = float(rng.uniform(2.0, 5.0)), float(rng.uniform(0.1, 0.8)) * x, float(rng.uniform(0.1, 0.6)) * y
    across = (length, 0.2) if rng.random() < 0.5 else (0.2, length)
    return shapely.box(u, v, u + across[0], v + across[1])


def _clutter(
    kind: str, spacing: np.ndarray, others: list[Area], size: tuple[float, float], rng: Rng
) -> tuple[Area, ...]:
    """Things of one size between columns, in rows."""
    length, width, _ = CLUTTER[kind]
    found, taken = [], united(others)
    for u in np.arange(spacing[0] / 2, size[0] - length, max(length, spacing[0] / 2) + 1.2):
        for v in np.arange(spacing[1] / 2, size[1] - width, width + LANE):
            thing = shapely.box(u, v, u + length, v + width)
            if rng.random() < STANDING and not thing.intersects(taken):
                found.append(thing)
    return tuple(found)


def write_hall(hall: Hall, mesh: Path | str, plan: Path | str) -> None:
    """Writes the hall as a mesh with its floor at 0, and its plan as GeoJSON (.geojson) or IFC (.ifc)."""
    import trimesh

    floor, top = shapely.box(0, 0, *hall.size), hall.height
    solid = united([hall.walls, *hall.columns])
    parts = [
        extruded(floor, -SLAB, 0.0), extruded(floor, top, top + SLAB), extruded(solid, 0.0, top),
        extruded(hall.doorways, LINTEL, top), *(extruded(c, 0.0, hall.clutter_height) for c in hall.clutter),
    ]  # fmt: skip
    trimesh.Trimesh(**trimesh.triangles.to_kwargs(np.concatenate(parts))).export(Path(mesh))
    planned = [(WALL, p) for p in shapely.get_parts(hall.walls)] + [(COLUMN, c) for c in hall.columns]
    if Path(plan).suffix == ".geojson":
        shapes = [(kind, shapely.geometry.mapping(p)) for kind, p in planned]
        features = [{"type": "Feature", "properties": {"kind": kind}, "geometry": shape} for kind, shape in shapes]
        return write_json(plan, {"type": "FeatureCollection", "features": features})
    writer = IfcWriter(hall.name, {"Hall": 0.0})
    for number, (kind, area) in enumerate(planned, 1):
        pieces = shapely.constrained_delaunay_triangles(area).geoms if area.interiors else [area]
        body = [Prism(tuple((x, y) for x, y in p.exterior.coords[:-1]), 0.0, hall.height) for p in pieces]
        writer.element(kind, f"{kind} {number}", "Hall", body)
    for number, room in enumerate(hall.rooms, 1):
        writer.space(f"{number}", "Hall", Prism(tuple((x, y) for x, y in room.exterior.coords[:-1]), 0.0, hall.height))
    writer.save(plan)
