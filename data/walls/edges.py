"""The sides of walls cut at one height: straight edges of the section, with their free side."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.polygon import orient

from data.geometry.areas import GRID, Area

Vec = NDArray[np.float64]  # (2,)
Points = NDArray[np.float64]  # (N, 2); a ring begins and ends with the same point
TIDY = 1e-4  # m: corners that stand out less are no corners
CURVE_FACET = 0.3  # m: chains of shorter edges that turn gently are curves
CURVE_TURN = np.radians(30.0)
CURVE_SAG = 0.015  # m: a curve stays this close to its chords
REVEAL_LENGTH = 1.0  # m: no wall is thicker
REVEAL_TURN = np.radians(60.0)
OPENING_WIDTH = 6.0  # m: no opening is wider


@dataclass(frozen=True, eq=False)
class Edge:
    """An edge from `start`, `length` metres along `along`; `normal` points out of the wall, right of `along`."""

    start: Vec
    along: Vec
    length: float

    @property
    def normal(self) -> Vec:
        """(2,) unit vector out of the wall."""
        return np.array([self.along[1], -self.along[0]])

    def shifted(self, distance: float) -> shapely.LineString:
        """The edge moved outwards along its normal."""
        a = self.start + distance * self.normal
        return shapely.LineString([a, a + self.length * self.along])

    def point(self, u: float) -> Vec:
        """The point `u` metres along the edge."""
        return self.start + u * self.along


def straightened(area: Area) -> Area:
    """Returns the area without redundant corners, with curves replaced by chords of at least about 0.3 m."""
    polygons = []
    for polygon in shapely.get_parts(area):
        polygon = _each_ring(orient(polygon), _without_flat)
        polygon = orient(shapely.simplify(polygon, TIDY))
        chorded = _each_ring(polygon, _chords)
        polygons.append(chorded if chorded.is_valid else polygon)
    return shapely.MultiPolygon(polygons)


def _each_ring(polygon: Area, change: Callable[[Points], Points]) -> Area:
    rings = [change(np.asarray(ring.coords)) for ring in (polygon.exterior, *polygon.interiors)]
    return shapely.Polygon(rings[0], rings[1:])


def is_pillar(polygon: Area) -> bool:
    """Whether no side of a polygon is as long as a wall's."""
    return bool(np.linalg.norm(np.diff(np.asarray(polygon.exterior.coords), axis=0), axis=1).max() < REVEAL_LENGTH)


def edges_of(area: Area, has_pillars: bool = False) -> list[Edge]:
    """The edges of a straightened area without the reveals of openings; `has_pillars`: small polygons have none."""
    edges = []
    for polygon in shapely.get_parts(area):
        opposite = polygon if has_pillars and is_pillar(polygon) else area
        for edge, turn, next_turn in _sides(polygon):
            square = min(abs(turn), abs(next_turn)) > REVEAL_TURN
            if not (square and edge.length < REVEAL_LENGTH and _faces_itself(edge, opposite)):
                edges.append(edge)
    return edges


def ends_of(area: Area, widest: float) -> list[Edge]:
    """The edges at the ends of walls of a straightened area: short ones between two outer corners."""
    sides = (side for polygon in map(orient, shapely.get_parts(area)) for side in _sides(polygon))
    return [edge for edge, turn, then in sides if min(turn, then) > REVEAL_TURN and edge.length <= widest]


def _sides(polygon: Area) -> Iterator[tuple[Edge, float, float]]:
    """The edges of a polygon's rings, with the turns at their start and at their end."""
    for ring in (polygon.exterior, *polygon.interiors):
        points = np.asarray(ring.coords)
        steps = np.diff(points, axis=0)
        lengths, turns = np.linalg.norm(steps, axis=1).tolist(), _turns(steps)
        rows = zip(points[:-1], steps, lengths, turns.tolist(), np.roll(turns, -1).tolist(), strict=True)
        yield from ((Edge(start, step / length, length), turn, then) for start, step, length, turn, then in rows)


def _faces_itself(edge: Edge, area: Area) -> bool:
    middle = edge.point(edge.length / 2)
    sight = shapely.LineString([middle + 0.01 * edge.normal, middle + OPENING_WIDTH * edge.normal])
    return bool(sight.intersects(area))


def _turns(steps: Points) -> NDArray[np.float64]:
    heading = np.arctan2(steps[:, 1], steps[:, 0])
    turn = heading - np.roll(heading, 1)
    return (turn + np.pi) % (2 * np.pi) - np.pi


def _without_flat(points: Points) -> Points:
    """A ring without the corners between triangles of one facet, which would blur where the facets end."""
    before, after = np.roll(points[:-1], 1, axis=0), np.roll(points[:-1], -1, axis=0)
    chord, reach = after - before, points[:-1] - before
    away = np.abs(chord[:, 0] * reach[:, 1] - chord[:, 1] * reach[:, 0])
    flat = away < 2 * GRID * np.linalg.norm(chord, axis=1)
    flat &= ~np.roll(flat, 1)  # never two in a row: they may be a fine curve
    kept = points[:-1][~flat]
    return np.vstack([kept, kept[:1]]) if len(kept) >= 3 else points


def _chords(points: Points) -> Points:
    """A ring (N + 1, 2) with each chain of short, gently turning edges replaced by chords."""
    steps = np.diff(points, axis=0)
    short = np.linalg.norm(steps, axis=1) < CURVE_FACET
    inside = short & np.roll(short, 1) & (np.abs(_turns(steps)) < CURVE_TURN)  # corners within a curve
    if not inside.any():
        return points
    if inside.all():  # a round pillar: one corner stays, the same at every height
        inside[np.lexsort(points[:-1].T.round(3))[0]] = False
    first = int(np.argmin(inside))  # the ring begins at a corner that stays
    ring, inside = np.roll(points[:-1], -first, axis=0), np.roll(inside, -first)
    ring, stays = np.vstack([ring, ring[:1]]), np.append(np.flatnonzero(~inside), len(inside))
    chords = [_greedy(ring[a : b + 1])[:-1] for a, b in pairwise(stays)]
    return np.vstack([*chords, ring[:1]])


def _greedy(chain: Points) -> Points:
    """Chords as long as CURVE_SAG allows; those of Douglas and Peucker would differ between heights."""
    kept = [0]
    for k in range(2, len(chain)):
        a, chord = chain[kept[-1]], chain[k] - chain[kept[-1]]
        skipped = chain[kept[-1] + 1 : k] - a
        away = np.abs(skipped[:, 0] * chord[1] - skipped[:, 1] * chord[0]).max()
        if away > CURVE_SAG * np.linalg.norm(chord):
            kept.append(k - 1)
    return chain[[*kept, len(chain) - 1]]
