"""The storeys of an A-graph for exploration: which rooms are connected, and walks through them."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from data.common.errors import UserError
from data.geometry import se2
from data.geometry.areas import Area, polygons_of
from data.geometry.se2 import Array
from data.scene_graph import Room, SceneGraph
from data.scene_graph.segments import Segments

Index = NDArray[np.int64]
Way = tuple[int, int]  # the place in the walk of the room that it leaves, and the next room
THICKEST = 0.35  # m, of a wall between two rooms
SQUARE = np.radians(10)  # the two sides of a wall are antiparallel within it
LEAST_BESIDE = 0.1  # m, of two sides of one wall
UNKNOWN_HALF = 1.0  # m, where only nearness matters


@dataclass(frozen=True, eq=False)
class Storey(Segments):
    """The rooms of one floor and the N wall surfaces that face them, in the A-graph's frame."""

    floor: str | None
    rooms: tuple[Room, ...]
    ids: tuple[str, ...]
    room: Index  # (N,) index into `rooms`
    doors: tuple[tuple[int, int, Array], ...]  # two rooms and the door's place (2,)

    @cached_property
    def walls_of(self) -> list[Index]:
        """The wall surfaces of each room, in the A-graph's order."""
        return [np.flatnonzero(self.room == k) for k in range(len(self.rooms))]

    @cached_property
    def middle(self) -> Array:
        """(rooms, 2) centroids."""
        return np.array([r.centroid for r in self.rooms], dtype=float)

    @cached_property
    def areas(self) -> list[Area | None]:
        """The rooms' footprints, None where there is none of any area."""
        areas = [polygons_of(shapely.Polygon(r.polygon)) if len(r.polygon or ()) > 2 else None for r in self.rooms]
        for area in areas:
            shapely.prepare(area)
        return [a if a is not None and a.area > 0 else None for a in areas]

    @cached_property
    def _extents(self) -> list[Area]:
        """Each room's footprint, else the box of its walls, else its centroid."""
        ends = np.concatenate((self.centre - self.arm, self.centre + self.arm), axis=1)
        places = [
            ends[walls].reshape(-1, 2) if len(walls) else self.middle[[k]] for k, walls in enumerate(self.walls_of)
        ]
        boxes = (shapely.multipoints(of).envelope.buffer(1e-9) for of in places)
        return [box if area is None else area for area, box in zip(self.areas, boxes, strict=True)]

    def holds(self, room: int, points: Array) -> bool:
        """Whether all of the points (M, 2) lie in a room."""
        return bool(shapely.contains_xy(self._extents[room], points[:, 0], points[:, 1]).all())

    def somewhere_in(self, room: int, rng: np.random.Generator) -> Array:
        """(2,) a random place in a room, drawn from the box around it; its centroid if no draw lies in the room."""
        low, high = np.reshape(self._extents[room].bounds, (2, 2))
        for place in rng.uniform(low, high, (20, 2)):
            if self.holds(room, place[None]):
                return np.asarray(place)
        return self.middle[room]

    @cached_property
    def by_door(self) -> list[list[int]]:
        """The rooms to which the doors of each room lead."""
        return _neighbours([(i, j) for i, j, _ in self.doors], len(self.rooms))

    @cached_property
    def across_walls(self) -> list[list[int]]:
        """The rooms behind a wall of each room: with antiparallel sides that are close and overlap."""
        half = np.where(np.isnan(self.half), UNKNOWN_HALF, self.half)
        arm = half[:, None] * self.tangent
        lines = shapely.linestrings(np.stack((self.centre - arm, self.centre + arm), axis=1))
        i, j = shapely.STRtree(lines).query(lines, predicate="dwithin", distance=THICKEST)
        apart = self.centre[j] - self.centre[i]
        behind = -np.einsum("ij,ij->i", apart, self.normal[i])
        beside = half[i] + half[j] - np.abs(np.einsum("ij,ij->i", apart, self.tangent[i]))
        turned = np.abs(se2.wrap(self.heading[j] - self.heading[i] + np.pi))
        wall = (turned < SQUARE) & (behind > -0.05) & (behind < THICKEST) & (beside > LEAST_BESIDE)
        pairs = np.unique(np.column_stack((self.room[i], self.room[j]))[wall], axis=0)
        return _neighbours([(a, b) for a, b in pairs.tolist() if a != b], len(self.rooms))

    @cached_property
    def reach(self) -> tuple[Index, Index]:
        """(rooms,) how many rooms with walls can be reached from each: by doors; by doors and across walls."""
        both = [a + b for a, b in zip(self.by_door, self.across_walls, strict=True)]
        return _sizes(self.by_door, self.walls_of), _sizes(both, self.walls_of)


@dataclass(frozen=True)
class Walk:
    """Rooms in the order of entry, and for each the position in it of the room it was entered from, -1 for the
    first.
    """

    rooms: tuple[int, ...]
    parents: tuple[int, ...]


def storeys_of(graph: SceneGraph) -> list[Storey]:
    """Returns the storeys with rooms that have wall surfaces, in the order of `floors`, then of appearance.

    The result is kept with the graph.
    """
    kept: dict[str, list[Storey]] = vars(graph)
    if "storeys" not in kept:
        kept["storeys"] = _storeys(graph)
    return kept["storeys"]


def walk(storey: Storey, rng: np.random.Generator, count: int | None, start: int | None = None) -> Walk:
    """Explores `count` rooms with walls, through doors, or across a wall if no door leads on.

    The first room is drawn among those from which the count can be reached, by doors alone if possible; fewer rooms are
    explored if there are no more. With `count` None all rooms are explored, unconnected ones by distance. `start` fixes
    the first room. Raises UserError for a count below 1.
    """
    walled = np.array([len(w) > 0 for w in storey.walls_of])
    wanted = int(walled.sum()) if count is None else count
    if wanted < 1:
        raise UserError(f"{count} rooms cannot be explored; ask for one at least")
    most = max(1, min(wanted, int(storey.reach[1].max())))
    starts = np.flatnonzero(walled & (storey.reach[0] >= most))
    starts = starts if len(starts) else np.flatnonzero(walled & (storey.reach[1] >= most))
    rooms, parents, doors, walls = list[int](), list[int](), list[Way](), list[Way]()

    def enter(room: int, parent: int) -> None:
        rooms.append(room)
        parents.append(parent)
        for ways, beyond in ((doors, storey.by_door), (walls, storey.across_walls)):
            ways += [(len(rooms) - 1, k) for k in beyond[room] if k not in rooms]

    def drawn(ways: list[Way]) -> Way | None:
        """A way to a new room, drawn uniformly."""
        while ways:
            n = int(rng.integers(len(ways)))
            ways[n], ways[-1] = ways[-1], ways[n]
            if (way := ways.pop())[1] not in rooms:
                return way
        return None

    enter(int(rng.choice(starts)) if start is None else start, -1)
    left = wanted - int(walled[rooms[0]])
    while left:
        way = drawn(doors) or drawn(walls)
        if way is None and count is None:
            way = _nearest_remaining(storey, rooms, walled)
        if way is None:
            break
        enter(way[1], way[0])
        left -= int(walled[way[1]])
    return Walk(tuple(rooms), tuple(parents))


def nearest_first(storey: Storey, start: int) -> tuple[Walk, int]:
    """Returns all rooms in the order of the distance from one room's middle, and how many of them doors connect.

    Distances follow straight lines from door to door. Since a model may lack doors, the remaining rooms follow across
    walls, nearest first.
    """
    rooms, parents, by_doors = [start], [-1], 0
    while True:
        for door in _doors_by_distance(storey, rooms[-1]):
            i, j, _ = storey.doors[door]
            if (i in rooms) != (j in rooms):
                parent, room = (i, j) if i in rooms else (j, i)
                parents.append(rooms.index(parent))
                rooms.append(room)
        by_doors = by_doors or len(rooms)
        steps = [(n, k) for n, r in enumerate(rooms) for k in storey.across_walls[r] if k not in rooms]
        if not steps:
            return Walk(tuple(rooms), tuple(parents)), by_doors
        at, room = min(steps, key=lambda step: math.dist(storey.middle[rooms[step[0]]], storey.middle[step[1]]))
        parents.append(at)
        rooms.append(room)


def _doors_by_distance(storey: Storey, start: int) -> list[int]:
    """The doors that can be reached from a room's middle, nearest first."""
    from scipy.sparse.csgraph import dijkstra  # slow to import

    joined = [(start, start), *((i, j) for i, j, _ in storey.doors)]
    place = np.array([storey.middle[start], *(at for _, _, at in storey.doors)])
    of = np.zeros((len(joined), len(storey.rooms)), dtype=np.float32)
    of[np.arange(len(joined))[:, None], joined] = 1.0
    apart = np.hypot(*(place[:, None] - place).transpose(2, 0, 1))
    # a way of no length, between two leaves of one door, would be none
    far = dijkstra(np.where(of @ of.T > 0, np.maximum(apart, 1e-9), 0.0), directed=False, indices=0)[1:]
    return [door for door in np.argsort(far, kind="stable").tolist() if np.isfinite(far[door])]


def _nearest_remaining(storey: Storey, rooms: list[int], walled: NDArray[np.bool_]) -> Way:
    others = np.setdiff1d(np.flatnonzero(walled), rooms)
    distance = np.linalg.norm(storey.middle[others, None] - storey.middle[None, rooms], axis=-1)
    k, n = np.unravel_index(int(distance.argmin()), distance.shape)
    return int(n), int(others[k])


def _storeys(graph: SceneGraph) -> list[Storey]:
    room_floor = {r.id: r.floor for r in graph.rooms}
    for surface in graph.wall_surfaces:
        if surface.room is not None and room_floor[surface.room] is None:
            room_floor[surface.room] = surface.floor
    floors = dict.fromkeys([*(f.id for f in graph.floors), *room_floor.values()])
    found = (_storey(graph, f, tuple(r for r in graph.rooms if room_floor[r.id] == f)) for f in floors)
    return [s for s in found if len(s.ids)]


def _storey(graph: SceneGraph, floor: str | None, rooms: tuple[Room, ...]) -> Storey:
    index = {r.id: k for k, r in enumerate(rooms)}
    walls = [w for w in graph.wall_surfaces if w.room in index]
    drawn, doors = Segments.of(walls), []
    for door in graph.doors:
        joined = sorted({index[r] for r in door.rooms if r in index})
        doors += [(i, j, np.array(door.centroid)) for i in joined for j in joined if i < j]
    ids, room = tuple(w.id for w in walls), np.array([index[str(w.room)] for w in walls], dtype=np.int64)
    return Storey(drawn.centre, drawn.heading, drawn.half, floor, rooms, ids, room, tuple(doors))


def _neighbours(pairs: list[tuple[int, int]], count: int) -> list[list[int]]:
    near: list[set[int]] = [set() for _ in range(count)]
    for i, j in pairs:
        near[i].add(j)
        near[j].add(i)
    return [sorted(n) for n in near]


def components(neighbours: list[list[int]]) -> Index:
    """(rooms,) labels from 0 on, equal for connected rooms."""
    from scipy.sparse import csr_array  # slow to import
    from scipy.sparse.csgraph import connected_components

    near = np.array([k for of in neighbours for k in of], dtype=np.int64)
    ends = np.cumsum([0, *map(len, neighbours)])
    graph = csr_array((np.ones(len(near)), near, ends), shape=(len(neighbours), len(neighbours)))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def _sizes(neighbours: list[list[int]], walls_of: list[Index]) -> Index:
    label = components(neighbours)
    walled = np.bincount(label[[len(walls) > 0 for walls in walls_of]], minlength=len(neighbours))
    return np.maximum(walled, 1)[label]
