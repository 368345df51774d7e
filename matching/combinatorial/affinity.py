"""The affinities of the combinatorial search: distances of rooms, distances and angles of walls as planes.

Walls are infinite: lengths, doors, adjacency and floors play no part.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from data.geometry.se2 import Array
from data.scene_graph import SceneGraph, WallSurface
from matching.arrays import Index
from matching.combinatorial.settings import CombinatorialSettings, Gaussian, Planes


@dataclass(frozen=True)
class Datums:
    """A graph for the search: M rooms and N walls."""

    rooms: tuple[str, ...]
    walls: tuple[str, ...]
    place: Array  # (M, 3) metres
    point: Array  # (N, 2) a point of each wall
    normal: Array  # (N, 2) unit vectors
    of_room: tuple[Index, ...]  # the walls of each room
    roomless: Index  # the walls of none

    @staticmethod
    def of(graph: SceneGraph, settings: CombinatorialSettings) -> "Datums":
        """Rooms are placed at the elevations of their floors where these are given."""
        height = {f.id: f.elevation or 0.0 for f in graph.floors} if settings.storeys_apart else {}
        place = [(*r.centroid, height.get(r.floor or "", 0.0)) for r in graph.rooms]
        row = {w.id: k for k, w in enumerate(graph.wall_surfaces)}
        normal = np.array([w.normal for w in graph.wall_surfaces], dtype=float).reshape(-1, 2)

        def rows(walls: Sequence[WallSurface]) -> Index:
            return np.array([row[w.id] for w in walls], dtype=np.int64)

        return Datums(
            tuple(r.id for r in graph.rooms), tuple(row), np.array(place, dtype=float).reshape(-1, 3),
            np.array([w.centroid for w in graph.wall_surfaces], dtype=float).reshape(-1, 2),
            normal / np.linalg.norm(normal, axis=-1, keepdims=True),  # of a map they are not quite
            tuple(rows(graph.surfaces_of_room[r.id]) for r in graph.rooms),
            rows([w for w in graph.wall_surfaces if w.room is None]),
        )  # fmt: skip

    def feet(self, walls: Index, room: int) -> Array:
        """(n, 2) the feet of the perpendiculars from a room's centre, relative to it."""
        normal = self.normal[walls]
        away = np.sum(normal * (self.point[walls] - self.place[room, :2]), axis=-1, keepdims=True)
        return np.asarray(away * normal)


@dataclass(frozen=True)
class Compared:
    """Distances (n, n) and angles (n, n) between n datums of one graph."""

    distance: Array
    angle: Array

    @staticmethod
    def of_points(points: Array) -> "Compared":
        """Rooms have no direction."""
        return Compared(_apart(points), np.zeros((len(points), len(points))))

    @staticmethod
    def of_walls(graph: Datums, walls: Index, room: int) -> "Compared":
        """Walls as planes about the centre of a room."""
        normal = graph.normal[walls]
        angle = np.arccos(np.clip(normal @ normal.T, -1.0, 1.0))
        np.fill_diagonal(angle, 0.0)  # rounding, which the arccosine makes large
        return Compared(_apart(graph.feet(walls, room)), angle)


def _apart(points: Array) -> Array:
    return np.asarray(np.linalg.norm(points[:, None] - points[None, :], axis=-1))


def room_affinity(settings: CombinatorialSettings, s: Compared, a: Compared, of_a: Index) -> Array:
    """(B, n, n) how similar the distances of n S rooms and of those A rooms (B, n) are; 1 on the diagonal.

    As published, rooms closer to each other than the bound never agree.
    """
    kernel = settings.rooms
    theirs = a.distance[of_a[:, :, None], of_a[:, None, :]]
    score = _gaussian(np.abs(theirs - s.distance), kernel)
    score *= (theirs >= kernel.bound) & (s.distance >= kernel.bound)
    n = of_a.shape[1]
    score[:, np.arange(n), np.arange(n)] = 1.0
    return score


def wall_affinity(planes: Planes, s: Compared, a: Compared, of_s: Index, of_a: Index) -> Array:
    """(..., n, n) how similar the relative poses of n S walls (..., n) and of those A walls (..., n) are."""
    distance, angle = (
        np.abs(x[of_a[..., :, None], of_a[..., None, :]] - y[of_s[..., :, None], of_s[..., None, :]])
        for x, y in ((a.distance, s.distance), (a.angle, s.angle))
    )
    both = _gaussian(distance, planes.distance) * _gaussian(angle, planes.angle)
    return np.asarray(both)


def fits_room(settings: CombinatorialSettings, s_feet: Array, a_feet: Array) -> Array:
    """(A walls, S walls) whether walls are equally far from the centres of their rooms, by the interlevel affinity."""
    away = np.abs(np.linalg.norm(a_feet, axis=-1)[:, None] - np.linalg.norm(s_feet, axis=-1)[None, :])
    return np.asarray(_gaussian(away, settings.planes.distance) >= settings.least_interlevel)


def _gaussian(x: Array, kernel: Gaussian) -> Array:
    return np.where(x < kernel.bound, np.exp(-0.5 * np.square(x / kernel.sigma)), 0.0)
