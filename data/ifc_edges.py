"""The sides of walls cut at one height: straight edges of the cut, each with the side that is free."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.polygon import orient

from data.areas import Area

Vec = NDArray[np.float64]  # (2,)
TIDY = 0.001  # m: corners that stand out less are no corners
CURVE_FACET = 0.3  # m: chains of shorter edges that turn gently are curves
CURVE_TURN = np.radians(30.0)
CURVE_SAG = 0.01  # m: a curve keeps this close to the chords that stand for it
REVEAL_LENGTH = 1.0  # m: no wall is thicker
REVEAL_TURN = np.radians(60.0)
OPENING_WIDTH = 6.0  # m: no opening is wider


@dataclass(frozen=True, eq=False)
class Edge:
    """From `start`, `length` metres along `along`; `normal` points out of the wall, right of `along`."""

    start: Vec
    along: Vec
    length: float

    @property
    def normal(self) -> Vec:
        """Unit, out of the wall."""
        return np.array([self.along[1], -self.along[0]])

    def shifted(self, distance: float) -> shapely.LineString:
        """The edge moved out along its normal."""
        a = self.start + distance * self.normal
        return shapely.LineString([a, a + self.length * self.along])

    def point(self, u: float) -> Vec:
        """`u` metres along the edge."""
        return self.start + u * self.along


def straightened(area: Area) -> Area:
    """The area with needless corners taken out and curves replaced by chords of about 0.3 m or longer."""
    polygons = []
    for polygon in shapely.get_parts(area):
        polygon = orient(shapely.simplify(polygon, TIDY))
        rings = [_chords(np.asarray(ring.coords)) for ring in (polygon.exterior, *polygon.interiors)]
        chorded = shapely.Polygon(rings[0], rings[1:])
        polygons.append(chorded if chorded.is_valid else polygon)
    return shapely.MultiPolygon(polygons)


def edges_of(area: Area) -> list[Edge]:
    """The edges of a straightened area; reveals of openings are left out."""
    edges = []
    for polygon in shapely.get_parts(area):
        for ring in (polygon.exterior, *polygon.interiors):
            points = np.asarray(ring.coords)
            steps = np.diff(points, axis=0)
            lengths = np.linalg.norm(steps, axis=1)
            turns = _turns(steps)  # at each edge's start
            for start, step, length, turn, next_turn in zip(
                points[:-1], steps, lengths, turns, np.roll(turns, -1), strict=True
            ):
                edge = Edge(start, step / length, float(length))
                square = min(abs(turn), abs(next_turn)) > REVEAL_TURN
                if not (square and length < REVEAL_LENGTH and _faces_itself(edge, area)):
                    edges.append(edge)
    return edges


def _faces_itself(edge: Edge, area: Area) -> bool:
    middle = edge.point(edge.length / 2)
    sight = shapely.LineString([middle + 0.01 * edge.normal, middle + OPENING_WIDTH * edge.normal])
    return bool(sight.intersects(area))


def _turns(steps: NDArray[np.float64]) -> NDArray[np.float64]:
    heading = np.arctan2(steps[:, 1], steps[:, 0])
    turn = heading - np.roll(heading, 1)
    return (turn + np.pi) % (2 * np.pi) - np.pi


def _chords(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """A ring (N + 1, 2) with each chain of short, gently turning edges simplified to within CURVE_SAG."""
    steps = np.diff(points, axis=0)
    short = np.linalg.norm(steps, axis=1) < CURVE_FACET
    inside = short & np.roll(short, 1) & (np.abs(_turns(steps)) < CURVE_TURN)  # corners within a curve
    if not inside.any():
        return points
    first = int(np.argmin(inside))  # a corner that stays, so that no curve is cut by the ring's seam
    ring = np.roll(points[:-1], -first, axis=0)
    inside = np.roll(inside, -first)
    ring, inside = np.vstack([ring, ring[:1]]), np.append(inside, False)
    stays = np.flatnonzero(~inside)
    if len(stays) < 2:
        return np.asarray(shapely.simplify(shapely.LinearRing(points), CURVE_SAG).coords)
    runs = [np.asarray(_simplified(ring[a : b + 1])) for a, b in pairwise(stays)]
    return np.vstack([*(run[:-1] for run in runs), ring[:1]])


def _simplified(points: NDArray[np.float64]) -> NDArray[np.float64]:
    if len(points) == 2:
        return points
    return np.asarray(shapely.simplify(shapely.LineString(points), CURVE_SAG).coords)
