"""Explores a storey from the nearest room to the farthest; maps of some of its rooms."""

import heapq
from collections.abc import Collection
from itertools import count

import numpy as np

from data.geometry.se2 import Array
from data.scene_graph import SceneGraph
from data.synthetic_maps.exploration import Storey, Walk
from data.synthetic_maps.noise_models import DrawnGraph


def nearest_first(storey: Storey, start: int) -> tuple[Walk, int]:
    """Returns all rooms in the order of the distance from one room's middle, and how many of them doors connect.

    Distances follow straight lines from door to door. Since a model may lack doors, the remaining rooms follow across
    walls, nearest first.
    """
    rooms, parents = [start], [-1]
    waiting = _Waiting(storey)
    waiting.enter(start, 0.0, storey.middle[start])
    by_doors = 0
    while True:
        while (reached := waiting.next()) is not None:
            parent, room = reached
            if room not in rooms:
                parents.append(rooms.index(parent))
                rooms.append(room)
        by_doors = by_doors or len(rooms)
        beyond = [(_apart(storey, r, k), n, k) for n, r in enumerate(rooms) for k in storey.across_walls[r]]
        beyond = [way for way in beyond if way[2] not in rooms]
        if not beyond:
            return Walk(tuple(rooms), tuple(parents)), by_doors
        far, parent, room = min(beyond)
        parents.append(parent)
        rooms.append(room)
        waiting.enter(room, far, storey.middle[room])


class _Waiting:
    """Dijkstra's queue over doors, by the distance at which a room is entered through each."""

    def __init__(self, storey: Storey) -> None:
        self._storey = storey
        self._doors_of: list[list[int]] = [[] for _ in storey.rooms]
        for n, (i, j, _) in enumerate(storey.doors):
            self._doors_of[i].append(n)
            self._doors_of[j].append(n)
        self._queue: list[tuple[float, int, int, int]] = []
        self._passed: set[tuple[int, int]] = set()
        self._tie = count()

    def enter(self, room: int, way: float, place: Array) -> None:
        """Adds the paths from a place in a room to its doors."""
        for door in self._doors_of[room]:
            far = way + float(np.hypot(*(self._storey.doors[door][2] - place)))
            heapq.heappush(self._queue, (far, next(self._tie), room, door))

    def next(self) -> tuple[int, int] | None:
        """The room left and the room entered through the nearest door not yet passed in this direction."""
        while self._queue:
            way, _, room, door = heapq.heappop(self._queue)
            if (room, door) in self._passed:
                continue
            self._passed.add((room, door))
            i, j, place = self._storey.doors[door]
            other = j if room == i else i
            self.enter(other, way, place)
            return room, other
        return None


def perfect_map(a: SceneGraph, rooms: Collection[str]) -> DrawnGraph:
    """Returns a noise-free map of some rooms of one storey (at least one), in the A-graph's frame and with its ids."""
    part = SceneGraph(
        "map",
        tuple(r for r in a.rooms if r.id in rooms),
        tuple(w for w in a.wall_surfaces if w.room in rooms),
        tuple(d for d in a.doors if len(d.rooms) > 1 and set(rooms).issuperset(d.rooms)),
    )
    own, still = {r.id: r.id for r in part.rooms}, (0.0, 0.0, 0.0)
    floor = next((r.floor or w.floor for r in part.rooms for w in a.surfaces_of_room[r.id]), part.rooms[0].floor)
    return DrawnGraph(
        part, own, {w.id: w.id for w in part.wall_surfaces}, still, dict.fromkeys(own, still), floor, False
    )


def _apart(storey: Storey, room: int, other: int) -> float:
    return float(np.hypot(*(storey.middle[other] - storey.middle[room])))
