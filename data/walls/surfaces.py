"""Wall surfaces: the sides of walls and columns that one can stand before, from cuts through them at three heights.

A cut shows what a LiDAR at that height would see: a parapet under a window stands in the low cut, a lintel
over a door in none. A side belongs to the room that one meets first when going out along its normal, and to none
where that is an open area: outdoors, a yard, a hall without a room.
"""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from functools import reduce

import numpy as np
import shapely
from numpy.typing import NDArray

from data.geometry.areas import Area, overlap
from data.geometry.intervals import SLIVER, Intervals, common, united, without
from data.scene_graph import WallSurface
from data.walls.edges import Edge, edges_of, straightened
from data.walls.rooms import Level
from data.walls.solids import Solid

CUTS = (0.513, 1.107, 1.703)  # m above the level; odd numbers meet no edge of a parapet or a lintel
STEPS = (0.01, 0.03, 0.06, 0.1, 0.14, 0.18, 0.22, 0.26, 0.3)  # m before a wall: plaster, finishes
DEPTH = 0.35  # m before a wall that is still in the room; an outline drawn around a thin wall ends earlier
TOUCH = 0.001  # m
SNAP = 0.1  # m: a room drawn short of a wall reaches to it
SAME_PLANE = 0.01  # m
SAME_ANGLE = float(np.cos(np.radians(0.5)))
CURTAIN_DEPTH = 0.2  # m: panes and mullions of one curtain wall are one surface
MAX_GAP = 2.5  # m: a door or window
BUTT = 0.02  # m: walls that meet end to end, drawn with a slit
MIN_LENGTH = 0.15  # m
MIN_ROOMLESS = 0.35  # m: the shortest wall in a map; the ends of walls outdoors are mostly shorter
MIN_HEIGHT = 0.3  # m


@dataclass(frozen=True, eq=False)
class _Piece:
    """The part of a wall's edge from `low` to `high` metres along it that faces `room`, in the section at `z`."""

    solid: Solid
    room: str | None
    edge: Edge
    low: float
    high: float
    z: float

    @property
    def length(self) -> float:
        """Metres."""
        return self.high - self.low

    def ends(self) -> NDArray[np.float64]:
        """(2, 2) both end points."""
        return np.stack([self.edge.point(self.low), self.edge.point(self.high)])


def surfaces_at(level: Level, solids: list[Solid]) -> list[WallSurface]:
    """The wall surfaces of one level, with empty ids."""
    pieces, cuts = [], []
    for height in CUTS:
        cut = [(s, straightened(s.section(level.bottom + height))) for s in solids]
        cut = [(s, area) for s, area in cut if not area.is_empty]
        pieces += _pieces(level, level.bottom + height, cut)
        cuts += [area for _, area in cut]
    return _merged(level, pieces, cuts)


def _pieces(level: Level, z: float, cut: list[tuple[Solid, Area]]) -> list[_Piece]:
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
                pieces += [_Piece(solid, ids[k], edge, low, high, z) for low, high in spans]
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


def _merged(level: Level, pieces: list[_Piece], cuts: list[Area]) -> list[WallSurface]:
    """Returns the surfaces, with empty ids. Pieces of one room in one plane are joined over gaps up to a door's width.

    If they face no room, pieces are not joined over a gap with a wall in it (`cuts`: the walls' sections).
    """
    of_room: dict[str | None, list[_Piece]] = defaultdict(list)
    for piece in pieces:
        of_room[piece.room].append(piece)
    walls = shapely.STRtree(cuts)
    surfaces = []
    for room, own in of_room.items():
        for plane, joined in _by_plane(own):
            spans = [_span(p, plane) for p in joined]
            for low, high in _joined_spans(spans, plane, None if room is not None else walls):
                surface = _surface(level, room, [p for p in joined if low <= _span(p, plane)[0] < high])
                if surface is not None:
                    surfaces.append(surface)
    return surfaces


def _by_plane(pieces: list[_Piece]) -> list[tuple[Edge, list[_Piece]]]:
    """Groups pieces by plane, starting with the longest, so that curves stay separate."""
    pieces = sorted(pieces, key=lambda p: -p.length)
    ends, along = np.stack([p.ends() for p in pieces]), np.stack([p.edge.along for p in pieces])
    solids = np.array([id(p.solid) for p in pieces])
    free = np.ones(len(pieces), dtype=bool)
    planes = []
    for k, reference in enumerate(pieces):
        if free[k]:
            curtain = reference.solid.kind == "IfcCurtainWall"
            depth = np.where(curtain & (solids == solids[k]), CURTAIN_DEPTH, SAME_PLANE)
            offset = np.abs((ends - reference.edge.start) @ reference.edge.normal).max(axis=1)
            here = free & (along @ reference.edge.along > SAME_ANGLE) & (offset < depth)
            here[k] = True
            free &= ~here
            planes.append((reference.edge, [pieces[i] for i in np.flatnonzero(here)]))
    return planes


def _span(piece: _Piece, plane: Edge) -> tuple[float, float]:
    low, high = (piece.ends() - plane.start) @ plane.along
    return float(low), float(high)


def _joined_spans(spans: Intervals, plane: Edge, walls: shapely.STRtree | None) -> Intervals:
    if walls is None:
        return united(spans, gap=MAX_GAP)
    result: Intervals = []
    for low, high in united(spans, gap=BUTT):
        if result and low - result[-1][1] <= MAX_GAP and not _wall_between(plane, result[-1][1], low, walls):
            low = result.pop()[0]
        result.append((low, high))
    return result


def _wall_between(plane: Edge, low: float, high: float, walls: shapely.STRtree) -> bool:
    front = [plane.point(u) + 0.05 * plane.normal for u in (low - 0.01, high + 0.01)]
    return bool(len(walls.query(shapely.LineString(front), predicate="intersects")))


def _surface(level: Level, room: str | None, pieces: list[_Piece]) -> WallSurface | None:
    """The surface in the plane of its longest piece; None if it is too slim or low."""
    plane = max(pieces, key=lambda p: p.length).edge
    spans = united([_span(p, plane) for p in pieces], gap=BUTT)
    of_solid: dict[Solid, Intervals] = defaultdict(list)
    for piece in pieces:
        of_solid[piece.solid].append(_span(piece, plane))
    extents = [(min(a for a, _ in own), max(b for _, b in own)) for own in of_solid.values()]
    if max(high - low for low, high in (*spans, *extents)) < (MIN_LENGTH if room is not None else MIN_ROOMLESS):
        return None  # edges of thin partitions in a row; two stumps of one wall beside its door are a surface
    low, high = spans[0][0], spans[-1][1]
    height = _height(level, room, plane, (low, high), list(of_solid))
    if height[1] - height[0] < MIN_HEIGHT:
        return None
    length_of = {s.id: sum(b - a for a, b in spans) for s, spans in of_solid.items()}
    source = max(sorted(length_of), key=lambda s: length_of[s])
    (x, y), (nx, ny) = plane.point((low + high) / 2).tolist(), plane.normal.tolist()
    floor = next((r.room.floor for r in level.rooms if r.room.id == room), level.floor)
    coefficients = (nx, ny, 0.0, -(nx * x + ny * y))
    parts = tuple(_standing(pieces, plane, (low + high) / 2))
    return WallSurface("", room, (x, y), (nx, ny), high - low, floor, source, height, coefficients, parts)


def _standing(pieces: list[_Piece], plane: Edge, middle: float) -> Iterator[tuple[str, float, float, bool]]:
    """Where which wall stands, relative to the `middle` of the surface, and whether it is in every section."""
    cuts = {p.z for p in pieces}
    found = []
    for solid in dict.fromkeys(p.solid for p in pieces):
        spans = [united([_span(p, plane) for p in pieces if p.solid is solid and p.z == z], gap=BUTT) for z in cuts]
        whole = reduce(common, spans)
        partly = without(united([span for own in spans for span in own]), whole)
        found += [(low, high, solid.id, True) for low, high in whole]
        found += [(low, high, solid.id, False) for low, high in partly]
    for low, high, source, is_whole in sorted(found):
        yield source, low - middle, high - middle, is_whole


def _height(
    level: Level, room: str | None, plane: Edge, span: tuple[float, float], solids: list[Solid]
) -> tuple[float, float]:
    """Lowest and highest z of the walls' upright faces in this plane, as far as the room reaches."""
    volume = next((r for r in level.rooms if r.room.id == room), level)
    bottom, top = volume.bottom, volume.top
    z = []
    for solid in solids:
        curtain = solid.kind == "IfcCurtainWall"
        faces = solid.upright_faces
        relative = faces[:, :, :2] - plane.start
        offset, u = np.abs(relative @ plane.normal).max(axis=1), relative @ plane.along
        here = (u.min(axis=1) < span[1] - 0.01) & (u.max(axis=1) > span[0] + 0.01)
        z.append(faces[here & (offset < (CURTAIN_DEPTH if curtain else 2 * SAME_PLANE)), :, 2].ravel())
    found = np.concatenate(z)
    if not len(found):
        return bottom, top
    return float(max(found.min(), bottom)), float(min(found.max(), top))
