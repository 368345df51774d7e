"""Wall surfaces: the sides of walls and columns that one can stand before, from cuts through them at three heights.

A cut shows what a LiDAR at that height would see: a parapet under a window stands in the low cut, a lintel
over a door in none. A side belongs to the room that one meets first when going out along its normal, and to none
where that is an open area: outdoors, a yard, a hall without a room.
"""

from collections.abc import Iterator

import numpy as np
import shapely

from data.geometry.areas import Area, overlap
from data.geometry.intervals import SLIVER, Intervals, common, united, without
from data.scene_graph import WallSurface
from data.walls.edges import Edge, edges_of, straightened
from data.walls.pieces import Piece, merged
from data.walls.rooms import Level
from data.walls.solids import Solid

CUTS = (0.513, 1.107, 1.703)  # m above the level; odd numbers meet no edge of a parapet or a lintel
STEPS = (0.01, 0.03, 0.06, 0.1, 0.14, 0.18, 0.22, 0.26, 0.3)  # m before a wall: plaster, finishes
DEPTH = 0.35  # m before a wall that is still in the room; an outline drawn around a thin wall ends earlier
TOUCH = 0.001  # m
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
    """The parts of the walls' sides that face a room or the open area at height `z`."""
    rooms = [r for r in level.rooms if r.bottom < z < r.top]
    ids: list[str | None] = [*(r.room.id for r in rooms), None]
    sides = [(solid, edge) for solid, area in cut for edge in edges_of(area, solid.is_building)]
    areas = [*(r.area for r in rooms), level.open]
    faced = _faced([edge for _, edge in sides], [area for _, area in cut], areas)
    pieces = []
    for (solid, edge), claims in zip(sides, faced, strict=True):
        stranger = level.own is not None and solid.id not in level.own
        for k, spans in claims.items():
            if ids[k] is not None or not stranger:
                pieces += [Piece(solid, ids[k], edge, low, high, z) for low, high in spans]
    return pieces


def _faced(edges: list[Edge], walls: list[Area], areas: list[Area]) -> list[dict[int, Intervals]]:
    """For each edge, which parts of it face which area: what meets a wall first, outward, faces none.

    The last area is the open one: only what meets nothing else faces it.
    """
    if not edges:
        return []
    wall_tree, area_tree, room_tree = (shapely.STRtree(a) for a in (walls, areas, areas[:-1]))
    lines = [edge.shifted(0.0) for edge in edges]
    near = np.unique(area_tree.query(lines, predicate="dwithin", distance=STEPS[-1] + 0.01)[0]).tolist()
    rest: dict[int, Intervals] = {k: [(0.0, edges[k].length)] for k in near}
    claims: list[dict[int, Intervals]] = [{} for _ in edges]
    free = rest
    for step in STEPS:
        for k, _, spans in _hits(edges, list(rest), step, wall_tree):
            rest[k] = without(rest[k], spans)
        free = dict(rest) if step == STEPS[0] else free
        for k, area, spans in _hits(edges, list(rest), step, area_tree if step == STEPS[-1] else room_tree):
            got = common(rest[k], spans)
            claims[k][area] = united(claims[k].get(area, []) + got, gap=TOUCH)
            rest[k] = without(rest[k], got)
        rest = {k: left for k, left in rest.items() if left}
    deep = {(k, area): spans for k, area, spans in _hits(edges, near, DEPTH, area_tree)}
    for k in near:
        in_depth = ((area, _mostly(spans, deep.get((k, area), []))) for area, spans in claims[k].items())
        claims[k] = {area: spans for area, spans in in_depth if spans}
        for area, spans in claims[k].items():
            taken = [s for other, own in claims[k].items() if other != area for s in own]
            claims[k][area] = _snapped(edges[k], spans, without(free[k], taken), wall_tree)
    return claims


def _hits(
    edges: list[Edge], active: list[int], step: float, tree: shapely.STRtree
) -> Iterator[tuple[int, int, Intervals]]:
    """Which active edges, shifted out by `step`, lie in which areas, and where, as metres along the edge."""
    lines = np.array([edges[k].shifted(step) for k in active], dtype=object)
    which, areas = tree.query(lines, predicate="intersects")
    order = np.lexsort((areas, which))
    which, areas = which[order], areas[order]
    common_parts = overlap(lines[which], tree.geometries[areas])
    for i, area, common_part in zip(which.tolist(), areas.tolist(), common_parts, strict=True):
        edge = edges[active[i]]
        inside = [p for p in getattr(common_part, "geoms", [common_part]) if p.length > SLIVER]
        along = [(np.asarray(p.coords) - edge.start) @ edge.along for p in inside]
        if along:
            yield active[i], area, united([(float(u.min()), float(u.max())) for u in along])


def _mostly(spans: Intervals, deep: Intervals) -> Intervals:
    """The spans of which at least half is in `deep`."""
    kept = []
    for low, high in spans:
        inside = sum(b - a for a, b in common([(low, high)], deep))
        if inside > 0.5 * (high - low):
            kept.append((low, high))
    return kept


def _snapped(edge: Edge, spans: Intervals, free: Intervals, walls: shapely.STRtree) -> Intervals:
    """The spans, drawn out to the ends of the free intervals that they nearly reach, where a wall stands."""
    result = []
    for low, high in spans:
        for a, b in free:
            if a < high and low < b:
                low = a if a < low < a + SNAP and _in_wall(edge, a - STEPS[0], walls) else low
                high = b if b - SNAP < high < b and _in_wall(edge, b + STEPS[0], walls) else high
        result.append((low, high))
    return united(result)


def _in_wall(edge: Edge, u: float, walls: shapely.STRtree) -> bool:
    point = shapely.Point(edge.point(u) + STEPS[0] * edge.normal)
    return len(walls.query(point, predicate="intersects")) > 0
