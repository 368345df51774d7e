"""Plans without heights (rooms as polygons, or walls alone, also as lines) as an A-graph, storey by storey."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from data.common.errors import UserError
from data.geometry.areas import GRID, Area, closed, polygons_of, united
from data.plans.polygons import DrawnRoom, scene_graph_of, with_pillars
from data.scene_graph import Floor, LevelSurface, Room, SceneGraph, WallSurface
from data.walls.edges import straightened
from data.walls.levels import normal_form
from data.walls.rooms import (
    DOORWAY,
    GAP,
    Level,
    closed_faces,
    doors_of,
    gaps,
    halls,
    open_area,
    rooms_of_faces,
)
from data.walls.solids import Prism
from data.walls.surfaces import surfaces_at

Array = NDArray[np.float64]
THICKEST = 0.65  # m: what is nowhere wider between two lines is a wall
THINNEST = 0.03  # m: lines closer than that are one wall's finishes
THIN = 0.1  # m: the thickness of a wall that is drawn as one line
SNAP = 1e-3  # m
MEET = 0.02  # m: ends of lines this close to another line are meant to meet it
HEIGHT = 2.6  # m: of a storey of unknown height; used internally only
PARTING = 0.01  # m: rooms that share an edge in a plan without walls have one this thin between them


@dataclass(frozen=True, eq=False)
class DrawnWalls:
    """The walls' footprints; `is_double` says whether most walls are drawn as two lines rather than one."""

    area: Area
    is_double: bool


def walls_of_lines(segments: Array, polygons: list[Area]) -> DrawnWalls:
    """Returns the walls of line segments (K, 2, 2) and of polygons that are walls themselves.

    Open ends opposite each other, a wall's thickness apart, are closed; gaps for doors stay open.
    """
    given = united(p.buffer(0.0) for p in polygons)
    if not len(segments):
        return DrawnWalls(given, bool(polygons))
    lines = _noded(segments)
    caps = _caps(lines)
    faces = shapely.get_parts(shapely.polygonize([shapely.union_all([lines, *caps], grid_size=SNAP)]))
    narrow = [f for f in faces if f.buffer(-THICKEST / 2).is_empty and not f.buffer(-THINNEST / 2).is_empty]
    walls = united([*narrow, given])
    alone = lines.difference(walls.buffer(2 * SNAP)) if not walls.is_empty else lines
    loose = [p for p in shapely.get_parts(alone) if p.length > THIN]
    thin = [p.buffer(THIN / 2, cap_style="square", join_style="mitre") for p in loose]
    return DrawnWalls(united([walls, *thin]), sum(p.length for p in loose) < lines.length / 2)


def _noded(segments: Array) -> Area:
    """The lines, cut where they cross or meet, with ends that nearly meet a line drawn up to it."""
    lines = shapely.linestrings(segments)
    tree = shapely.STRtree(lines)
    ends = shapely.points(segments.reshape(-1, 2))
    which, near = tree.query(ends, predicate="dwithin", distance=MEET)
    other = near != which // 2
    which, near = which[other], near[other]
    joints = shapely.shortest_line(ends[which], lines[near])
    joints = joints[shapely.length(joints) > SNAP / 10]
    return shapely.union_all([*lines, *joints], grid_size=SNAP)


def _caps(lines: Area) -> list[Area]:
    """Lines between loose ends that are each other's nearest."""
    coordinates = [np.asarray(p.coords)[[0, -1]] for p in shapely.get_parts(lines)]
    if not coordinates:
        return []
    nodes, counts = np.unique(np.concatenate(coordinates).round(4), axis=0, return_counts=True)
    loose = nodes[counts == 1]
    if len(loose) < 2:
        return []
    far, nearest = cKDTree(loose).query(loose, k=2)
    of = nearest[:, 1]
    mutual = [i for i in range(len(loose)) if i < of[i] and of[of[i]] == i and far[i, 1] < THICKEST]
    return [shapely.LineString(loose[[i, of[i]]]) for i in mutual]


def even_odd(rings: list[Array]) -> Area:
    """The area that closed rings (N, 2) fill, a ring within another being a hole."""
    area = shapely.Polygon()
    for ring in rings:
        area = shapely.symmetric_difference(area, polygons_of(shapely.Polygon(ring)), grid_size=GRID)
    return polygons_of(area)


@dataclass(frozen=True, eq=False)
class FlatStorey:
    """A drawn storey: `walls` is the area of walls and windows, `rooms` are id, name and area, `doors` areas.

    `elevation` is the z of its floor and `height` that of its rooms, if known, and `is_level` whether that is so in all
    of its rooms. Metres.
    """

    name: str
    walls: Area = field(default_factory=shapely.Polygon)
    rooms: Sequence[tuple[str, str, Area]] = ()
    doors: Sequence[Area] = ()
    elevation: float | None = None
    height: float | None = None
    is_level: bool = True


def graph_of_storeys(storeys: Sequence[FlatStorey], where: str) -> tuple[SceneGraph, tuple[str, ...]]:
    """Returns the A-graph (frame "bim") and notices.

    A storey without rooms gets the closed faces between its walls; gaps between wall ends of up to 1.6 m, of halls up
    to 6 m, are taken for doors. Raises UserError if there are no walls.
    """
    graphs, notices = [], []
    for number, storey in enumerate(storeys, 1):
        floor = Floor(f"storey-{number}", storey.name, storey.elevation if storey.elevation is not None else 0.0)
        graph = _with_rooms(storey, floor) if storey.rooms else _between_walls(storey, floor)
        graphs.append(graph)
        if not storey.rooms:
            made = len(graph.rooms)
            notices.append(f"{storey.name or floor.id}: {made} rooms were made of the closed faces between walls")
    surfaces = tuple(w for g in graphs for w in g.wall_surfaces)
    if not surfaces:
        raise UserError(f"{where}: no walls were found in it; give a plan with walls or rooms")
    rooms, doors = tuple(r for g in graphs for r in g.rooms), tuple(d for g in graphs for d in g.doors)
    floors = tuple(f for g in graphs for f in g.floors)
    levels = tuple(v for g, storey in zip(graphs, storeys, strict=True) for v in _levels(g.rooms, storey))
    return SceneGraph("bim", rooms, surfaces, doors, floors, level_surfaces=levels), tuple(notices)


def _levels(rooms: Sequence[Room], storey: FlatStorey) -> Iterator[LevelSurface]:
    """The floors and ceilings of a storey's rooms, as far as their heights are given."""
    if storey.elevation is None or not storey.is_level:
        return
    for room in rooms:
        assert room.polygon is not None
        floor = LevelSurface(
            f"{room.id}/level-1", normal_form((storey.elevation, 0.0, 0.0), is_floor=True), room.polygon
        )
        yield replace(floor, room=room.id, floor=room.floor)
        if storey.height is not None:
            plane = normal_form((storey.elevation + storey.height, 0.0, 0.0), is_floor=False)
            yield replace(floor, id=f"{room.id}/level-2", plane=plane, room=room.id, floor=room.floor)


def _with_rooms(storey: FlatStorey, floor: Floor) -> SceneGraph:
    key = floor.id
    walls = storey.walls
    if walls.is_empty:  # rooms that touch have a wall between them that is not drawn
        walls = united(area.boundary.buffer(PARTING) for _, _, area in storey.rooms)
    bottom = floor.elevation or 0.0
    height = None if storey.height is None else (bottom, bottom + storey.height)
    rooms = with_pillars([
        DrawnRoom(f"{key}/{id}" + (f".{n}" if n else ""), part, name, key, height)
        for id, name, area in storey.rooms for n, part in enumerate(shapely.get_parts(polygons_of(area)))
    ], storey.walls)  # fmt: skip
    doors = ((f"{key}/door-{k}", area) for k, area in enumerate(storey.doors, 1))
    graph = scene_graph_of(rooms, doors, walls, (floor,))
    passages = tuple(replace(d, id=f"{key}/{d.id}") if d.id.startswith("passage") else d for d in graph.doors)
    level = Level(key, bottom, bottom + (storey.height or HEIGHT))
    outside = roomless_surfaces(storey.walls, [*(r.area for r in rooms), *storey.doors], level)
    surfaces = (_named(s, f"{key}/surface-{k}", storey) for k, s in enumerate(outside, 1))
    return replace(graph, doors=passages, wall_surfaces=(*graph.wall_surfaces, *surfaces))


def roomless_surfaces(walls: Area, others: Iterable[Area], level: Level) -> list[WallSurface]:
    """The sides of drawn `walls`, with empty ids, that face no room; `others` are the rooms and doors of the level."""
    if walls.is_empty:
        return []
    walls = straightened(polygons_of(walls))
    return surfaces_at(replace(level, open=open_area(walls, others)), [Prism.of(walls, level.bottom, level.top)])


def _between_walls(storey: FlatStorey, floor: Floor) -> SceneGraph:
    if storey.walls.is_empty:
        return SceneGraph("bim", floors=(floor,))
    walls = straightened(polygons_of(storey.walls))
    bottom = floor.elevation or 0.0
    top = bottom + (storey.height or HEIGHT)
    doorways = list(gaps(walls, DOORWAY))
    shut = closed(united([walls, *doorways, *storey.doors]), GAP)
    faces = closed_faces(shut)
    gained, gates = halls(shut, faces)
    faces += gained
    volumes = rooms_of_faces(faces, floor.id, floor.id, bottom, top)
    level = Level(floor.id, bottom, top, volumes, open_area(united([shut, *gates]), faces))
    found = sorted(surfaces_at(level, [Prism.of(walls, bottom, top)]), key=lambda s: s.room is None)
    surfaces = tuple(_named(s, f"{floor.id}/surface-{k}", storey) for k, s in enumerate(found, 1))
    openings = [*storey.doors, *shapely.get_parts(united(doorways)), *shapely.get_parts(united(gates))]
    doors = tuple(doors_of(floor.id, openings, volumes))
    return SceneGraph("bim", tuple(v.room for v in volumes), surfaces, doors, (floor,))


def _named(surface: WallSurface, id: str, storey: FlatStorey) -> WallSurface:
    known = storey.height is not None
    parts = tuple(("", low, high, full) for _, low, high, full in surface.parts)  # it is of no wall in the plan
    return replace(surface, id=id, source="", height=surface.height if known else None, parts=parts)
