"""Finds walls in the lines of a drawing, in metres: the area between two lines a wall's thickness apart."""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from data.geometry.areas import GRID, Area, polygons_of, united

Array = NDArray[np.float64]
THICKEST = 0.65  # m: what is nowhere wider between two lines is a wall
THINNEST = 0.03  # m: lines closer than that are one wall's finishes
THIN = 0.1  # m: the thickness of a wall that is drawn as one line
SNAP = 1e-3  # m
MEET = 0.02  # m: ends of lines this close to another line are meant to meet it


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
