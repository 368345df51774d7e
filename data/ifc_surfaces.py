"""Wall surfaces: the sides that walls turn to rooms, from cuts through the walls at three heights.

A cut shows what a LiDAR at that height would see: a parapet under a window stands in the low cut, a lintel
over a door in none. A side belongs to the room that one meets first when going out along its normal.
"""

import numpy as np
import shapely

from data.areas import Area, overlap
from data.ifc_edges import Edge, edges_of, straightened
from data.ifc_faces import Piece, merged
from data.ifc_rooms import Level
from data.ifc_sections import Solid
from data.intervals import SLIVER, Intervals, common, united, without
from data.scene_graph import WallSurface

CUTS = (0.513, 1.107, 1.703)  # m above the level; odd numbers meet no edge of a parapet or a lintel
STEPS = (0.01, 0.03, 0.06, 0.1, 0.14, 0.18, 0.22, 0.26, 0.3)  # m before a wall: plaster, finishes
Target = tuple[str | None, Area]  # a room's id, None for an unknown area
SNAP = 0.1  # m: a room drawn short of a wall reaches to it


def surfaces_at(level: Level, solids: list[Solid]) -> list[WallSurface]:
    """The wall surfaces of one level, with empty ids."""
    pieces, cuts = [], []
    for height in CUTS:
        cut = [(s, straightened(s.section(level.bottom + height))) for s in solids]
        cut = [(s, area) for s, area in cut if not area.is_empty]
        pieces += _pieces(level, level.bottom + height, cut)
        cuts += [area for _, area in cut]
    return merged(level, pieces, cuts)


def _pieces(level: Level, z: float, cut: list[tuple[Solid, Area]]) -> list[Piece]:
    """The parts of the walls' sides that face a room or a kept unknown area at height `z`."""
    rooms = [r for r in level.rooms if r.bottom < z < r.top]
    targets: list[Target] = [(r.room.id, r.area) for r in rooms]
    targets += [] if level.unknown.is_empty else [(None, level.unknown)]
    sides = [(solid, edge) for solid, area in cut for edge in edges_of(area)]
    if not targets or not sides:
        return []
    lines = [edge.shifted(0.0) for _, edge in sides]
    near_targets = _near(lines, [area for _, area in targets])
    near_walls = _near(lines, [area for _, area in cut])
    pieces = []
    for k, (solid, edge) in enumerate(sides):
        source = solid.product.global_id
        facing = [targets[t] for t in near_targets[k]]
        if level.own is not None and source not in level.own:
            facing = [f for f in facing if f[0] is not None]
        if facing:
            walls = [cut[w][1] for w in near_walls[k]]
            for room, spans in _faced(edge, walls, facing).items():
                pieces += [Piece(solid, room, edge, low, high) for low, high in spans]
    return pieces


def _near(lines: list[shapely.LineString], areas: list[Area]) -> list[list[int]]:
    near: list[list[int]] = [[] for _ in lines]
    pairs = shapely.STRtree(areas).query(lines, predicate="dwithin", distance=STEPS[-1] + 0.01)
    for line, area in sorted(zip(*pairs.tolist(), strict=True)):
        near[line].append(area)
    return near


def _faced(edge: Edge, walls: list[Area], facing: list[Target]) -> dict[str | None, Intervals]:
    """Which parts of an edge face which room: out along the normal, what meets a wall first faces none."""
    claims: dict[str | None, Intervals] = {room: [] for room, _ in facing}
    rest: Intervals = [(0.0, edge.length)]
    free = rest
    for step in STEPS:
        line = edge.shifted(step)
        for wall in walls:
            rest = without(rest, _spans(edge, line, wall))
        free = rest if step == STEPS[0] else free
        for room, area in facing:
            got = common(rest, _spans(edge, line, area))
            claims[room] = united(claims[room] + got, gap=0.001)
            rest = without(rest, got)
        if not rest:
            break
    claimed = {room: spans for room, spans in claims.items() if spans}
    for room, spans in claimed.items():
        taken = [s for other, theirs in claimed.items() if other != room for s in theirs]
        claimed[room] = _snapped(edge, spans, without(free, taken), walls)
    return claimed


def _spans(edge: Edge, line: shapely.LineString, area: Area) -> Intervals:
    """Where the shifted edge lies within the area, as metres along the edge."""
    inside = [p for p in shapely.get_parts(overlap(line, area)) if p.length > SLIVER]
    spans = [(np.asarray(p.coords) - edge.start) @ edge.along for p in inside]
    return united([(float(s.min()), float(s.max())) for s in spans])


def _snapped(edge: Edge, spans: Intervals, free: Intervals, walls: list[Area]) -> Intervals:
    """The spans, drawn out to the ends of the free intervals that they nearly reach, where a wall stands."""
    result = []
    for low, high in spans:
        for a, b in free:
            if a < high and low < b:
                low = a if a < low < a + SNAP and _in_wall(edge, a - STEPS[0], walls) else low
                high = b if b - SNAP < high < b and _in_wall(edge, b + STEPS[0], walls) else high
        result.append((low, high))
    return united(result)


def _in_wall(edge: Edge, u: float, walls: list[Area]) -> bool:
    x, y = edge.point(u) + STEPS[0] * edge.normal
    return any(shapely.intersects_xy(wall, x, y) for wall in walls)
