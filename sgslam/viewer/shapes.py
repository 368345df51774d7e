"""Lines and triangles of walls and rooms for the viewer, in metres."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from data import SceneGraph, WallSurface
from data.geometry.areas import polygons_of, triangles_of
from data.scene_graph import WALL_HEIGHT

Floats = NDArray[np.float64]


def elevation_of(graph: SceneGraph | None, floor: str | None) -> float:
    """The elevation (m) of a floor; 0 if unknown."""
    floors = graph.floors if graph is not None else ()
    return next((f.elevation for f in floors if f.id == floor and f.elevation is not None), 0.0)


def wall_quads(surfaces: Sequence[WallSurface], below: float, absolute: bool) -> Floats:
    """(N, 4, 3) corners of wall surfaces, around each: two below, two above. Heights are `absolute` z, as in a plan, or
    relative to the floor at z = `below`."""
    corners = np.empty((len(surfaces), 4, 3))
    for row, surface in zip(corners, surfaces, strict=True):
        low, high = surface.height or (0.0, WALL_HEIGHT)
        if surface.height is None or not absolute:
            low, high = low + below, high + below
        row[:, :2] = np.array(surface.ends())[[0, 1, 1, 0]]
        row[:, 2] = low, low, high, high
    return corners


def quad_triangles(corners: Floats) -> Floats:
    """(2 N, 3, 3) the triangles of quadrilaterals (N, 4, 3)."""
    return corners[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 3)


def ring_lines(rings: Iterable[Any], z: float) -> Floats:
    """(N, 2, 3) the edges of open rings, each (K, 2), at height `z`."""
    sides = [np.empty((0, 2, 2))]
    for ring in rings:
        points = np.asarray(ring, dtype=float)
        sides.append(np.stack([points, np.roll(points, -1, axis=0)], axis=1))
    flat = np.concatenate(sides)
    return np.concatenate([flat, np.full((*flat.shape[:2], 1), z)], axis=2)


def polygon_triangles(ring: Any, z: float) -> Floats:
    """(T, 3, 3) the triangles of the area within a ring (K, 2) at height `z`; none for an area of zero."""
    flat = triangles_of(polygons_of(shapely.Polygon(ring if len(ring) > 2 else ())))
    return np.concatenate([flat, np.full((len(flat), 3, 1), z)], axis=2)


def path_lines(points: Floats) -> Floats:
    """(N - 1, 2, 3) the segments of the path through points (N, 3)."""
    return np.stack([points[:-1], points[1:]], axis=1)
