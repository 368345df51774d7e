"""A plan as a mesh that can be driven through: rooms between walls, doorways under lintels, floor and ceiling; or as an
IFC file whose floors and ceilings lie at several heights: suspended ceilings over all or half of a room, platforms,
raised floors, ramps, galleries.

The same plan and seed give the same building; written `flat` it has none of these.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import ifcopenshell
import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.ops import nearest_points

from data.common.errors import UserError
from data.generation import DEMO_FILE
from data.geometry.areas import Area, largest, overlap, polygons_of, triangles_of, united
from data.ifc.graph import read_ifc
from data.ifc.writer import IfcWriter, Prism, box, placed
from data.scene_graph import Door, SceneGraph

Rng = np.random.Generator
Array = NDArray[np.float64]
OUTER = 0.3  # m, thickness of outer walls; walls between rooms are at most twice as thick
SLAB = 0.2  # m
HEIGHT = 2.75  # m, of a room
LINTEL = 2.1  # m, clear height of a doorway
DOORWAY = 0.9  # m wide
REACH = 0.05  # m that a doorway's outline reaches into the rooms
STOREY = "Ground floor"
HEIGHTS = (2.9, 3.4)  # m, clear, of rooms without galleries
HIGH = (5.2, 6.0)  # m: with galleries
HUNG, PANEL = (0.25, 0.55), 0.02  # m: by which ceilings are suspended, and their thickness
RISES = {"platform": 0.2, "raised floor": 0.3, "ramp": 0.3}  # m
DEPTHS = {"platform": 0.4, "raised floor": 0.65, "ramp": 0.5, "gallery": 0.4}  # of a room's length
GALLERY = 2.8  # m above the floor
CLEAR = 1.1  # m between a door and what rises from the floor
SMALLEST = 8.0  # m2: of a room whose floor is not level
LEAF = 0.04  # m
SLIVER = 1e-3  # m2


@dataclass(frozen=True, eq=False)
class DrawnStorey:
    """The first storey of a plan in plan view: its rooms by id, its outline, the walls between them, the lines through
    its doors, from room to room, and the parts of the walls that are open under a lintel."""

    rooms: dict[str, Area]
    outline: Area
    walls: Area
    doors: list[shapely.LineString]
    doorways: Area


def drawn_storey(graph: SceneGraph) -> DrawnStorey:
    """The first storey of a plan whose rooms have polygons. Raises UserError for a plan without rooms."""
    floor = graph.floors[0].id if graph.floors else None
    rooms = {r.id: shapely.Polygon(r.polygon) for r in graph.rooms if r.polygon is not None and r.floor == floor}
    if not rooms:
        raise UserError(f"{graph.frame}: a plan without rooms; give one whose rooms have outlines")
    inside = united(list(rooms.values()))
    outline = inside.buffer(OUTER, join_style="mitre")
    doors = [line for door in graph.doors if (line := _through(door, rooms)) is not None]
    doorways = united(line.buffer(DOORWAY / 2, cap_style="flat") for line in doors)
    return DrawnStorey(rooms, outline, outline.difference(inside), doors, doorways)


def plan_triangles(graph: SceneGraph) -> Array:
    """(M, 3, 3) the first storey of a plan whose rooms have polygons, turned outwards, with the floor at 0. Raises
    UserError for a plan without rooms."""
    storey = drawn_storey(graph)
    parts = (
        extruded(storey.outline, -SLAB, 0.0),
        extruded(storey.walls.difference(storey.doorways), 0.0, LINTEL),
        extruded(storey.walls, LINTEL, HEIGHT),
        extruded(storey.outline, HEIGHT, HEIGHT + SLAB),
    )
    return np.concatenate(parts)


def write_plan_mesh(graph: SceneGraph, path: Path | str) -> None:
    """Writes the first storey of a plan as a mesh; see `plan_triangles`."""
    import trimesh

    trimesh.Trimesh(**trimesh.triangles.to_kwargs(plan_triangles(graph))).export(Path(path))


def _through(door: Door, rooms: dict[str, Area]) -> shapely.LineString | None:
    """The line through the wall between a door's two rooms, None for any other door."""
    joined = [rooms[name] for name in door.rooms if name in rooms]
    if len(joined) != 2:
        return None
    ends = np.array([nearest_points(room, shapely.Point(door.centroid))[0].coords[0] for room in joined])
    across = (ends[1] - ends[0]) / max(float(np.linalg.norm(ends[1] - ends[0])), 1e-6)
    return shapely.LineString([ends[0] - REACH * across, ends[1] + REACH * across])


def extruded(area: Area, low: float, high: float) -> Array:
    """(M, 3, 3) the surface of a body with this outline from a lower to an upper height, turned outwards."""
    import trimesh

    corners = triangles_of(area).reshape(-1, 2)
    vertices, faces = np.unique(corners, axis=0, return_inverse=True)
    body = trimesh.creation.extrude_triangulation(vertices, faces.reshape(-1, 3), high - low)
    return np.asarray(body.triangles) + np.array([0.0, 0.0, low])


def write_level_building(plan: SceneGraph, path: Path | str, seed: int, high: bool = False, flat: bool = False) -> None:
    """Writes the first storey of a plan as an IFC file, with features in its rooms unless it is `flat`; `high` rooms
    have galleries instead of ceilings where they are large. Raises UserError for a plan without rooms."""
    rng = np.random.default_rng([seed, 65])
    storey, height = drawn_storey(plan), float(rng.uniform(*(HIGH if high else HEIGHTS)))
    writer = IfcWriter.begun(f"Levels {seed}", {STOREY: 0.0})
    for part in shapely.get_parts(storey.walls):
        pierced = part.difference(storey.doorways)
        writer.element("IfcWall", "Wall", STOREY, [*prisms(pierced, 0.0, LINTEL), *prisms(part, LINTEL, height)])
    for line in storey.doors:
        (x, y), (u, v) = np.asarray(line.centroid.coords)[0], np.diff(np.asarray(line.coords), axis=0)[0]
        leaf = box(-DOORWAY / 2, -LEAF, 0.0, DOORWAY / 2, LEAF, LINTEL)
        writer.element("IfcDoor", "Door", STOREY, [leaf], placed(x, y, yaw=float(np.arctan2(v, u)) - np.pi / 2))
    write_rooms(writer, list(storey.rooms.values()), storey.outline, height, SLAB)
    if not flat:
        middles = [line.centroid for line in storey.doors]
        _add_levels(writer, STOREY, list(storey.rooms.values()), middles, height, rng)
    writer.save(path)


def write_rooms(writer: IfcWriter, rooms: Sequence[Area], outline: Area, height: float, slab: float) -> None:
    """Writes rooms of a clear `height` (m), and the slabs below and above the building's `outline`, `slab` m thick."""
    for kind, low in (("BASESLAB", -slab), ("ROOF", height)):
        writer.element("IfcSlab", "Slab", STOREY, prisms(outline, low, low + slab), kind=kind)
    for number, room in enumerate(rooms, 1):
        writer.space(f"{number}", STOREY, prisms(room, 0.0, height)[0])


def write_level_demo(path: Path | str, seed: int, flat: bool = False) -> None:
    """Writes the demo's two storeys, which a stair joins, with features in all rooms but the stair's."""
    rng, writer = np.random.default_rng([seed, 66]), IfcWriter(ifcopenshell.open(DEMO_FILE))
    plan, _ = read_ifc(DEMO_FILE)
    for floor in () if flat else plan.floors:
        rooms = [room for room in plan.rooms if room.floor == floor.id and room.polygon is not None]
        ids = {room.id for room in rooms}
        doors = [shapely.Point(np.round(door.centroid, 3)) for door in plan.doors if ids.intersection(door.rooms)]
        areas = [tidied(shapely.Polygon(room.polygon)) for room in rooms if not room.name.endswith("Stairs")]
        _add_levels(writer, floor.name, areas, doors, HEIGHTS[0], rng)
    writer.save(path)


def _add_levels(
    writer: IfcWriter, storey: str, rooms: Sequence[Area], doors: Sequence[shapely.Point], height: float, rng: Rng
) -> None:
    """Draws and writes the features of rooms of a clear `height` (m) on one storey: suspended ceilings in half of them,
    at one of two heights, one in three over half of its room; galleries; in half of the larger rooms what rises from
    the floor, where the doors leave space for it."""
    usual = rng.uniform(*HUNG, 2)
    for room in rooms:
        hung, has_ceiling, is_half = float(rng.choice(usual)), rng.random() < 0.5, rng.random() < 1 / 3
        kind = tuple(RISES)[int(rng.integers(len(RISES)))]
        rises, is_large = rng.random() < 0.5, room.area > SMALLEST
        if height > HIGH[0] and is_large:
            end, z = _end_of(room, DEPTHS["gallery"], doors)[0], (GALLERY, GALLERY + SLAB)
            writer.element("IfcSlab", "gallery", storey, prisms(end, *z), kind="FLOOR")
        elif has_ceiling:
            area, z = _end_of(room, 0.5, doors)[0] if is_half else room, (height - hung, height - hung + PANEL)
            writer.element("IfcCovering", "ceiling", storey, prisms(area, *z), kind="CEILING")
        end, upward = _end_of(room, DEPTHS[kind], doors)
        if not (rises and is_large and all(end.distance(door) > CLEAR for door in doors)):
            continue
        if kind == "ramp":
            body, T_storey_ramp = _wedge(end, upward)
            writer.element("IfcRamp", kind, storey, [body], T_storey_ramp)
        else:
            writer.element("IfcSlab", kind, storey, prisms(end, 0.0, RISES[kind]), kind="FLOOR")


def _end_of(room: Area, share: float, doors: Sequence[shapely.Point]) -> tuple[Area, Array]:
    """The end of a room, a share of its length, that is farther from the doors, and the direction (2,) to it."""
    corners = np.asarray(shapely.oriented_envelope(room).exterior.coords)[:4]
    sides = [corners[1] - corners[0], corners[3] - corners[0]]
    long, wide = sorted(sides, key=lambda side: -float(np.hypot(*side)))
    ends = []
    for base, direction in ((corners[0], long), (corners[0] + long, -long)):
        strip = shapely.Polygon([base, base + wide, base + wide + share * direction, base + share * direction])
        ends.append((largest(polygons_of(overlap(room, strip))), -direction / np.hypot(*direction)))
    return max(ends, key=lambda end: min((end[0].distance(door) for door in doors), default=0.0))


def _wedge(area: Area, upward: Array) -> tuple[Prism, Array]:
    """A wedge over a rectangle: a triangle that is extruded across it, and its place in the storey: x along the ramp, y
    up, z to the right."""
    across = np.array([-upward[1], upward[0]])
    places = np.asarray(area.exterior.coords) @ np.stack([upward, across], axis=1)
    (begin, right), (end, left) = places.min(axis=0).tolist(), places.max(axis=0).tolist()
    T = np.eye(4)
    T[:3, :3] = [[upward[0], 0.0, -across[0]], [upward[1], 0.0, -across[1]], [0.0, 1.0, 0.0]]
    T[:2, 3] = begin * upward + left * across
    return Prism(((0.0, 0.0), (end - begin, 0.0), (end - begin, RISES["ramp"])), 0.0, left - right), T


def tidied(area: shapely.Polygon) -> shapely.Polygon:
    """Returns the polygon in whole millimetres, without redundant corners, starting at a well-defined corner."""
    return shapely.normalize(shapely.set_precision(area, 0.001).simplify(0.0005))


def prisms(area: Area, low: float, high: float) -> list[Prism]:
    """The bodies over an area."""
    parts = [tidied(part) for part in shapely.get_parts(area) if part.area > SLIVER]
    rings = ([tuple((x, y) for x, y in ring.coords[:-1]) for ring in (p.exterior, *p.interiors)] for p in parts)
    return [Prism(outer, low, high, tuple(holes)) for outer, *holes in rings]
