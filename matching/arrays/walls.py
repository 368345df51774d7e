"""A scene graph's wall surfaces and doors as arrays, storey by storey, in a frame that follows the walls."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from data.geometry import se2
from data.geometry.se2 import Array
from data.scene_graph import Room, SceneGraph, WallSurface
from data.scene_graph.segments import Segments
from matching.arrays.free_space import FreeSpace

T = TypeVar("T")
Index = NDArray[np.int64]
BUILDING_GAP = 10.0  # metres
PLANS_CACHED = 4
UNKNOWN_HALF_LENGTH = 1.0  # metres, if neither the graph nor the room's other walls give it


@dataclass(frozen=True)
class Walls(Segments):
    """N wall surfaces of one storey in their own frame: origin at their mean, x along most walls.

    The own frame makes all later steps independent of the graph's frame. `T_graph_own` (yaw, x, y) maps it to the
    graph's.
    """

    ids: tuple[str, ...]
    floor: str | None
    known: NDArray[np.bool_]  # (N,) whether the length was given
    room: Index  # (N,) index into `rooms`, -1 where not known
    rooms: tuple[Room, ...]
    T_graph_own: Array  # (3,) yaw, x, y

    def __len__(self) -> int:
        return len(self.ids)

    def __getitem__(self, chosen: Index) -> "Walls":
        """Some of the walls; frame and rooms stay."""
        ids = tuple(self.ids[n] for n in chosen.tolist())
        centre, heading, half = self.centre[chosen], self.heading[chosen], self.half[chosen]
        known, room = self.known[chosen], self.room[chosen]
        return Walls(centre, heading, half, ids, self.floor, known, room, self.rooms, self.T_graph_own)

    @cached_property
    def lines(self) -> Array:
        """(N, 6) half length, heading, normal (2), and the centre along the normal and along the tangent."""
        n_x, n_y = self.normal.T
        x, y = self.centre.T
        return np.stack((self.half, self.heading, n_x, n_y, n_x * x + n_y * y, n_x * y - n_y * x), axis=-1)

    @cached_property
    def free_space(self) -> FreeSpace:
        """That of the rooms with an outline."""
        return FreeSpace.of(self)

    @property
    def area(self) -> float:
        """Square metres on which there are walls."""
        return float(self.building_areas.sum())

    @cached_property
    def building(self) -> Index:
        """(N,) the building of each wall: walls more than 10 m away from all others are of another building."""
        return _buildings(self.centre, self.tangent, self.half)

    @cached_property
    def building_areas(self) -> Array:
        """(buildings,) square metres of boxes along the walls about their mid points, extended by a metre."""
        areas = []
        for k in range(int(self.building.max()) + 1):
            own = self.building == k
            turned = se2.rotate(-_grid(self.heading[own], self.half[own]), self.centre[own])
            areas.append((np.ptp(turned, axis=0) + 1.0).prod())
        return np.array(areas)

    @cached_property
    def first_of_room(self) -> Index:
        """(rooms,) the first wall of each room."""
        with_room = np.flatnonzero(self.room >= 0)
        return np.asarray(with_room[np.unique(self.room[with_room], return_index=True)[1]])

    @cached_property
    def weight(self) -> Array:
        """(N,) the weight of each surface: grows with its length, but a long one is still one observation."""
        return np.sqrt(np.clip(2 * self.half, 0.35, 6.0))


@dataclass(frozen=True)
class Doors:
    """N doors between rooms, in the own frame of the walls."""

    place: Array  # (N, 2)
    rooms: Index  # (N, 2) indices into the walls' rooms; -1 where a door leads out, or to a room without walls

    def __len__(self) -> int:
        return len(self.rooms)


def storeys(graph: SceneGraph) -> list[Walls]:
    """Returns the graph's storeys that have wall surfaces, in the order of `floors`, then of appearance."""
    floor_of = {r.id: r.floor for r in graph.rooms}

    def floor(surface: WallSurface) -> str | None:
        return surface.floor if surface.floor is not None or surface.room is None else floor_of[surface.room]

    by_floor: dict[str | None, list[WallSurface]] = {f.id: [] for f in graph.floors}
    for surface in graph.wall_surfaces:
        by_floor.setdefault(floor(surface), []).append(surface)
    return [arrays(graph, f, surfaces) for f, surfaces in by_floor.items() if surfaces]


def arrays(graph: SceneGraph, floor: str | None, surfaces: list[WallSurface]) -> Walls:
    """Returns some wall surfaces (at least one) of a graph as arrays, taken as one storey."""
    faced = {w.room for w in surfaces}
    rooms = [r for r in graph.rooms if r.id in faced]
    index = {r.id: k for k, r in enumerate(rooms)}
    drawn = Segments.of(surfaces)
    centre, heading, half = drawn.centre, drawn.heading, drawn.half
    known = ~np.isnan(half)
    room = np.array([index[w.room] if w.room is not None else -1 for w in surfaces], dtype=np.int64)
    grid = _grid(heading, np.where(known, half, 0.5))
    T_graph_own = np.array([grid, *centre.mean(axis=0)])
    own = se2.rotate(-grid, centre - centre.mean(axis=0))
    heading = se2.wrap(heading - grid)
    if not known.all():
        half = np.where(known, half, _half_from_room(own, heading, room))
    return Walls(own, heading, half, tuple(w.id for w in surfaces), floor, known, room, tuple(rooms), T_graph_own)


def doors(graph: SceneGraph, walls: Walls) -> Doors:
    """The doors of a graph that lead into a room of these walls."""
    index = {room.id: n for n, room in enumerate(walls.rooms)}
    joined = [(*(index.get(r, -1) for r in door.rooms[:2]), -1, -1)[:2] for door in graph.doors]
    rooms = np.array(joined, dtype=np.int64).reshape(-1, 2)
    place = np.array([door.centroid for door in graph.doors], dtype=float).reshape(-1, 2)
    here = (rooms >= 0).any(axis=1)
    return Doors(se2.apply(se2.inverse(walls.T_graph_own), place[here]), rooms[here])


def between_graphs(s: Walls, a: Walls, motion: Array) -> Array:
    """(3,) T_a_s between the graphs' frames, from a motion between their own frames."""
    return se2.compose(se2.compose(a.T_graph_own, motion), se2.inverse(s.T_graph_own))


class PlanCache(Generic[T]):
    """The results of a function for the last few graphs; a graph is recognised by its identity."""

    def __init__(self, work: Callable[[SceneGraph], T]) -> None:
        self._work = work
        self._known: dict[int, tuple[SceneGraph, T]] = {}  # the last used is last

    def __call__(self, graph: SceneGraph) -> T:
        """Returns the function's result for a graph."""
        # The graph is kept too, so that no other gets its id.
        known = self._known.pop(id(graph), None) or (graph, self._work(graph))
        self._known[id(graph)] = known
        if len(self._known) > PLANS_CACHED:
            del self._known[next(iter(self._known))]
        return known[1]


def points_along(centre: Array, tangent: Array, half: Array, count: Index) -> tuple[Array, Index]:
    """(P, 2) `count` (N,) points along each wall, at least two, from end to end; and (P,) the walls they belong to."""
    wall = np.repeat(np.arange(len(half)), count)
    step = np.arange(len(wall)) - np.repeat(np.cumsum(count) - count, count)
    along = (2 * step / (count[wall] - 1) - 1) * half[wall]
    return centre[wall] + along[:, None] * tangent[wall], wall


def _grid(heading: Array, weight: Array) -> float:
    """Direction of the building's grid from the fourth harmonic, since most walls are at right angles."""
    return float(np.angle(np.sum(weight * np.exp(4j * heading))) / 4)


def _buildings(centre: Array, tangent: Array, half: Array) -> Index:
    """(N,) labels, equal for walls that are near each other."""
    from scipy.sparse import coo_matrix  # slow to import
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    points, wall = points_along(centre, tangent, half, np.ceil(2 * half / BUILDING_GAP).astype(np.int64) + 1)
    i, j = cKDTree(points).query_pairs(BUILDING_GAP, output_type="ndarray").T
    near = coo_matrix((np.ones(len(i)), (wall[i], wall[j])), shape=(len(half), len(half)))
    return np.asarray(connected_components(near, directed=False)[1], dtype=np.int64)


def _half_from_room(centre: Array, heading: Array, room: Index) -> Array:
    """(N,) half length such that the surface reaches the nearest wall of its room that it would meet."""
    slope = np.sin(se2.wrap(heading[None, :] - heading[:, None]))  # of the tangent of i, along the normal of j
    normal = np.stack((np.cos(heading), np.sin(heading)), axis=-1)
    offset = np.einsum("ijk,jk->ij", centre[None, :] - centre[:, None], normal)
    parallel = np.abs(slope) < np.sin(np.radians(30))
    along = np.where(parallel, np.inf, offset / np.where(parallel, 1.0, slope))  # of i, to where the line of j crosses
    same = (room[:, None] == room[None, :]) & (room >= 0)[:, None]
    reach = np.min(np.where(same & (np.abs(along) > 0.1), np.abs(along), np.inf), axis=1, initial=np.inf)
    return np.where(np.isfinite(reach), np.clip(reach, 0.2, 5.0), UNKNOWN_HALF_LENGTH)
