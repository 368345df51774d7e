"""Synthetic buildings with strong perceptual aliasing: a corridor and a ring of corridors with identical offices."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray

Floats = NDArray[np.float64]
HEIGHT, DOOR_HEIGHT = 2.8, 2.1  # m
PITCH, DEPTH, DOOR, WALL = 3.3, 4.5, 0.9, 0.12  # m, of an office: along the corridor, across it, its door, its walls
WIDTH = 2.0  # m, of a corridor
_TALL = 1.4  # m from the corridor's wall to a cupboard in each office


@dataclass(frozen=True)
class LoopBuilding:
    """A building for loop-closure tests, in metres.

    `triangles` (M, 3, 3), the floor at z = 0; `doors` (D, 2) the middles of the doors; `inside` (D, 2) a point in the
    office behind each door; `way` (N, 2) the centre line of the corridor.
    """

    triangles: Floats
    doors: Floats
    inside: Floats
    way: Floats


def long_corridor(offices: int = 18) -> LoopBuilding:
    """A straight corridor with `offices` identical offices on either side; only its ends are distinctive."""
    length = offices * PITCH
    along = (np.arange(offices) + 0.5) * PITCH
    cells = [(x, side) for side in (-1.0, 1.0) for x in along]
    rows = [_office(np.array([x, 0.0]), np.array([1.0, 0.0]), np.array([0.0, side])) for x, side in cells]
    corridor = shapely.box(0.0, -WIDTH / 2, length, WIDTH / 2)
    return _drawn([corridor], rows, np.array([[1.0, 0.0], [length - 1.0, 0.0]]))


def ring(across: int = 12, deep: int = 8) -> LoopBuilding:
    """Four corridors around a core, with `across` and `deep` identical offices along the outside of each side."""
    half = np.array([across * PITCH, deep * PITCH]) / 2
    rows = []
    for axis, count in ((0, across), (1, deep)):
        other = 1 - axis
        for side in (-1.0, 1.0):
            tangent, out = np.zeros(2), np.zeros(2)
            tangent[axis], out[other] = 1.0, side
            for x in (np.arange(count) + 0.5 - count / 2) * PITCH:
                rows.append(_office(tangent * x + out * half[other], tangent, out))
    outer = shapely.box(*(-half - WIDTH / 2), *(half + WIDTH / 2))
    corridor = outer.difference(shapely.box(*(-half + WIDTH / 2), *(half - WIDTH / 2)))
    x, y = half.tolist()
    way = np.array([[0.0, -y], [x, -y], [x, y], [-x, y], [-x, -y], [0.0, -y]])
    return _drawn([corridor], rows, way)


@dataclass(frozen=True)
class _Room:
    area: shapely.Polygon
    door: shapely.Polygon
    cupboard: shapely.Polygon
    middle: Floats
    inside: Floats


def _office(place: Floats, tangent: Floats, out: Floats) -> _Room:
    """The office whose door is beside `place` (2,) on the centre line; `out` (2,) points into the office."""

    def area(low: float, high: float, near: float, far: float) -> shapely.Polygon:
        corners = [place + a * tangent + b * out for a, b in ((low, near), (high, near), (high, far), (low, far))]
        return shapely.Polygon(corners)

    near, half = WIDTH / 2 + WALL, (PITCH - WALL) / 2
    door = area(-DOOR / 2, DOOR / 2, WIDTH / 2 - 0.01, near + 0.01)
    cupboard = area(half - 0.45, half + 0.01, near + _TALL, near + _TALL + 1.2)
    middle = place + WIDTH / 2 * out
    return _Room(area(-half, half, near, near + DEPTH), door, cupboard, middle, place + (near + 1.6) * out)


def _drawn(corridors: Sequence[shapely.Polygon], rooms: Sequence[_Room], way: Floats) -> LoopBuilding:
    open_above = shapely.union_all([*corridors, *(r.area for r in rooms)])
    furnished = open_above.difference(shapely.union_all([r.cupboard for r in rooms]))
    doors = [r.door for r in rooms]
    below = shapely.union_all([furnished, *doors])
    x0, y0, x1, y1 = below.bounds
    triangles = [*_upright(below, 0.0, DOOR_HEIGHT), *_upright(open_above, DOOR_HEIGHT, HEIGHT)]
    triangles += [*_level(x0, y0, x1, y1, 0.0), *_level(x0, y0, x1, y1, HEIGHT)]
    for door in doors:
        x0, y0, x1, y1 = door.bounds
        triangles += _level(x0, y0, x1, y1, DOOR_HEIGHT)
    middles, insides = np.array([r.middle for r in rooms]), np.array([r.inside for r in rooms])
    return LoopBuilding(np.array(triangles), middles, insides, way)


def _upright(area: shapely.Geometry, low: float, high: float) -> list[Floats]:
    """The walls around an area, two triangles for each edge."""
    result = []
    for part in getattr(area, "geoms", [area]):
        for line in (part.exterior, *part.interiors):
            corners = np.asarray(line.coords)
            for (ax, ay), (bx, by) in pairwise(corners.tolist()):
                a, b, c, d = (ax, ay, low), (bx, by, low), (bx, by, high), (ax, ay, high)
                result += [np.array([a, b, c]), np.array([a, c, d])]
    return result


def _level(x0: float, y0: float, x1: float, y1: float, z: float) -> list[Floats]:
    a, b, c, d = (x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)
    return [np.array([a, b, c]), np.array([a, c, d])]
