"""The parts of a map that are treated as rigid (its rooms), and which of them are neighbours."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled, compiled_within
from data.geometry.se2 import Array
from matching.arrays.walls import Doors, Index, Walls

BESIDE = 0.8  # metres between the walls of neighbours: a wall's thickness and its errors
POINTS = 0.5  # metres between points of a wall
BEHIND = 1.0  # metres that a room behind a stray wall counts as further away
MOST_NEIGHBOURS = 6
CELL = 6.0  # metres, of the parts of a map without rooms
NO_DOOR = 2.5  # slack between neighbours without a known door


@dataclass(frozen=True)
class Groups:
    """G parts of a map. `edges` join neighbours so that the whole is connected."""

    of_wall: Index  # (Ns,)
    centre: Array  # (G, 2) mean of the walls' centres
    edges: Index  # (E, 2)
    slack: Array  # (E,) how much more the motions may differ than from a room through a door into the next
    hops: Index  # (G, G) steps from one to another; one that is not through a door counts twice

    def __len__(self) -> int:
        return len(self.centre)


def groups(s: Walls, doors: Doors, rigid: bool = False) -> Groups:
    """Returns the groups of a map with at least one wall, given its doors: its rooms, or one if it is `rigid`."""
    of_wall = np.zeros(len(s), dtype=np.int64) if rigid else rooms_of_walls(s)
    size = np.bincount(of_wall)
    centre = np.stack([np.bincount(of_wall, s.centre[:, k]) / size for k in (0, 1)], axis=-1)
    through = doors.rooms[(doors.rooms >= 0).all(axis=1)]
    group = of_wall[s.first_of_room[through]] if len(through) else through
    edges, by_door = _edges(_apart(s, of_wall, centre), group)
    steps = np.where(by_door | (not by_door.any()), 1, 2)
    return Groups(of_wall, centre, edges, np.where(by_door, 1.0, NO_DOOR), _hops(edges, steps, len(size)))


def rooms_of_walls(s: Walls) -> Index:
    """(Ns,) the room of each wall: of one without, the nearest on the side that it faces; a map without rooms is cut
    into cells."""
    stray, with_room = np.flatnonzero(s.room < 0), np.flatnonzero(s.room >= 0)
    if not len(stray):
        return s.room  # each room has a wall
    if not len(with_room):
        return np.asarray(np.unique(np.floor(s.centre / CELL), axis=0, return_inverse=True)[1].reshape(-1))
    size = np.bincount(s.room[with_room], minlength=len(s.rooms))
    sums = [np.bincount(s.room[with_room], s.centre[with_room, k], len(s.rooms)) for k in (0, 1)]
    middle = np.stack([total / size for total in sums], axis=-1)
    return np.asarray(_rooms_of_stray_walls(s.room, s.centre, s.normal, middle))


@compiled
def _rooms_of_stray_walls(room: Index, centre: Array, normal: Array, middle: Array) -> Index:
    """(Ns,) the room of each wall; `middle` (R, 2) are the means of the rooms' walls."""
    found = room.copy()
    for i in range(len(room)):
        nearest = np.inf
        for k in range(len(room)):
            if room[i] < 0 <= room[k]:
                towards = middle[room[k]] - centre[i]
                behind = towards[0] * normal[i, 0] + towards[1] * normal[i, 1] < 0
                far = np.hypot(centre[k, 0] - centre[i, 0], centre[k, 1] - centre[i, 1]) + BEHIND * behind
                if far < nearest:
                    nearest, found[i] = far, room[k]
    return found


def _apart(s: Walls, of_wall: Index, centre: Array) -> Array:
    """(G, G) approximate distances in metres between the walls of groups; more than 10 if none are near."""
    points = np.maximum(np.ceil(2 * s.half / POINTS).astype(np.int64), 1)
    square = _least_squares_apart(s.centre, s.tangent, s.half, points, of_wall, len(centre))
    far = 10 + np.hypot(*(centre[:, None] - centre[None]).transpose(2, 0, 1))
    return np.asarray(np.where(np.isfinite(square), np.sqrt(square), far))


@compiled
def _least_squares_apart(
    centre: Array, tangent: Array, half: Array, points: Index, of_wall: Index, count: int
) -> Array:
    """(G, G) smallest squared distances in metres, infinite if none are near; walls are sampled as points."""
    reach = BESIDE + POINTS / 2
    least = np.full((count, count), np.inf)
    for i in range(len(half)):
        for k in range(i):
            g, h = of_wall[i], of_wall[k]
            x, y = centre[i, 0] - centre[k, 0], centre[i, 1] - centre[k, 1]
            far = half[i] + half[k] + reach
            if g == h or x * x + y * y > far * far:
                continue
            for n in range(points[i]):
                at = (2 * ((n + 0.5) / points[i]) - 1) * half[i]
                u, v = x + at * tangent[i, 0], y + at * tangent[i, 1]
                run = u * tangent[k, 0] + v * tangent[k, 1]
                if abs(u * tangent[k, 1] - v * tangent[k, 0]) > reach or abs(run) > half[k] + reach:
                    continue
                begin = int(((run - reach) / half[k] + 1) / 2 * points[k]) if half[k] > 0 else 0
                end = int(((run + reach) / half[k] + 1) / 2 * points[k]) + 1 if half[k] > 0 else points[k]
                for m in range(max(begin - 1, 0), min(end + 1, points[k])):
                    at = (2 * ((m + 0.5) / points[k]) - 1) * half[k]
                    square = (u - at * tangent[k, 0]) ** 2 + (v - at * tangent[k, 1]) ** 2
                    if square <= reach * reach and square < least[g, h]:
                        least[g, h] = least[h, g] = square
    return least


@compiled
def _edges(apart: Array, doors: Index) -> tuple[Index, NDArray[np.bool_]]:
    """(E, 2) edges by doors (D, 2), by nearness, and to connect all; and which of them are doors."""
    count = len(apart)
    by_door, kept = np.zeros((count, count), dtype=np.bool_), np.zeros((count, count), dtype=np.bool_)
    for d in range(len(doors)):
        g, h = doors[d, 0], doors[d, 1]
        if g != h:
            by_door[g, h] = by_door[h, g] = True
            apart[g, h] = apart[h, g] = 1e-6
    nearest, total = np.empty(MOST_NEIGHBOURS, dtype=np.int64), 0
    for g in range(count):
        apart[g, g], known = np.inf, 0
        for h in range(count):
            if apart[g, h] >= 10:
                continue
            at = known
            while at > 0 and apart[g, h] < apart[g, nearest[at - 1]]:
                if at < MOST_NEIGHBOURS:
                    nearest[at] = nearest[at - 1]
                at -= 1
            if at < MOST_NEIGHBOURS:
                nearest[at], known = h, min(known + 1, MOST_NEIGHBOURS)
        for n in range(known):
            kept[g, nearest[n]] = kept[nearest[n], g] = True
    _join_all(apart, kept)
    for g in range(count):
        for h in range(g):
            total += kept[g, h]
    edges, through, e = np.empty((total, 2), dtype=np.int64), np.empty(total, dtype=np.bool_), 0
    for g in range(count):
        for h in range(g + 1, count):
            if kept[g, h]:
                edges[e, 0], edges[e, 1], through[e] = g, h, by_door[g, h]
                e += 1
    return edges, through


@compiled_within
def _join_all(apart: Array, kept: NDArray[np.bool_]) -> None:
    """Adds the shortest spanning tree (R. C. Prim: Shortest connection networks, 1957), preferring existing edges."""
    count = len(apart)
    far, link = np.full(count, np.inf), np.zeros(count, dtype=np.int64)
    new = 0
    for _ in range(count - 1):
        far[new], nearest = -1.0, -1  # it is in the tree
        for g in range(count):
            there = (1 - 1e-9) * apart[new, g] if kept[new, g] else apart[new, g]
            if there < far[g]:
                far[g], link[g] = there, new
            if far[g] >= 0 and (nearest < 0 or far[g] < far[nearest]):
                nearest = g
        new = nearest
        kept[new, link[new]] = kept[link[new], new] = True


@compiled
def _hops(edges: Index, steps: Index, count: int) -> Index:
    """(G, G) lengths of the shortest paths; an edge counts 1 or 2."""
    first, beside = np.zeros(count + 1, dtype=np.int64), np.empty((2 * len(edges), 2), dtype=np.int64)
    for e in range(len(edges)):
        first[edges[e, 0] + 1] += 1
        first[edges[e, 1] + 1] += 1
    for g in range(count):
        first[g + 1] += first[g]
    at = first.copy()
    for e in range(len(edges)):
        for g, h in ((edges[e, 0], edges[e, 1]), (edges[e, 1], edges[e, 0])):
            beside[at[g], 0], beside[at[g], 1] = h, steps[e]
            at[g] += 1
    hops = np.full((count, count), 2 * count)
    for start in range(count):
        steps_from = hops[start]
        steps_from[start], steps_done, last = 0, 0, 0
        while steps_done <= last:
            for g in range(count):
                if steps_from[g] == steps_done:
                    for n in range(first[g], first[g + 1]):
                        there = steps_from[g] + beside[n, 1]
                        if there < steps_from[beside[n, 0]]:
                            steps_from[beside[n, 0]], last = there, max(last, there)
            steps_done += 1
    return hops
