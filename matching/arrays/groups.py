"""The parts of a map that are treated as rigid (its rooms), and which of them are neighbours."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from data.geometry.se2 import Array
from matching.arrays.walls import Doors, Index, Walls

BESIDE = 0.8  # metres between the walls of neighbours: a wall's thickness and its errors
POINTS = 0.5  # metres between points of a wall
BEHIND = 1.0  # metres that a room behind a wall without a room counts as further away
FAR, TOUCHING = 10.0, 1e-6  # metres from which on groups are no neighbours, and between those joined by a door
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
    centre = _means(s.centre, of_wall)
    through = doors.rooms[(doors.rooms >= 0).all(axis=1)]
    group = of_wall[s.first_of_room[through]] if len(through) else through
    edges, by_door = _edges(_apart(s, of_wall, centre), group)
    steps = np.where(by_door | (not by_door.any()), 1, 2)
    return Groups(of_wall, centre, edges, np.where(by_door, 1.0, NO_DOOR), _hops(edges, steps, len(centre)))


def rooms_of_walls(s: Walls) -> Index:
    """(Ns,) the room of each wall: of one without, the nearest on the side that it faces; a map without rooms is cut
    into cells."""
    roomless, with_room = np.flatnonzero(s.room < 0), np.flatnonzero(s.room >= 0)
    if not len(roomless):
        return s.room  # each room has a wall
    if not len(with_room):
        return np.asarray(np.unique(np.floor(s.centre / CELL), axis=0, return_inverse=True)[1].reshape(-1))
    middle = _means(s.centre[with_room], s.room[with_room])[s.room[with_room]]
    towards, off = (to[None] - s.centre[roomless, None] for to in (middle, s.centre[with_room]))
    behind = (towards * s.normal[roomless, None]).sum(axis=-1) < 0
    found = s.room.copy()
    found[roomless] = s.room[with_room][(np.hypot(*off.transpose(2, 0, 1)) + BEHIND * behind).argmin(axis=1)]
    return found


def _means(points: Array, of: Index) -> Array:
    """(groups, 2) the mean of each group's points; each has one."""
    size = np.bincount(of)
    return np.stack([np.bincount(of, points[:, k]) / size for k in (0, 1)], axis=-1)


def _apart(s: Walls, of_wall: Index, centre: Array) -> Array:
    """(G, G) approximate distances in metres between the walls of groups; more than `FAR` if none are near."""
    points = np.maximum(np.ceil(2 * s.half / POINTS).astype(np.int64), 1)
    square = _least_squares_apart(s.centre, s.tangent, s.half, points, of_wall, len(centre))
    far = FAR + np.hypot(*(centre[:, None] - centre[None]).transpose(2, 0, 1))
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
                for m in range(points[k]):
                    at = (2 * ((m + 0.5) / points[k]) - 1) * half[k]
                    square = (u - at * tangent[k, 0]) ** 2 + (v - at * tangent[k, 1]) ** 2
                    if square <= reach * reach and square < least[g, h]:
                        least[g, h] = least[h, g] = square
    return least


def _edges(apart: Array, doors: Index) -> tuple[Index, NDArray[np.bool_]]:
    """(E, 2) edges by doors (D, 2), by nearness, and to connect all; and which of them are doors."""
    by_door, near = np.zeros((2, *apart.shape), dtype=np.bool_)
    by_door[doors[:, 0], doors[:, 1]] = by_door[doors[:, 1], doors[:, 0]] = True
    np.fill_diagonal(by_door, False)
    apart = np.where(by_door, TOUCHING, apart)
    np.fill_diagonal(apart, np.inf)
    np.put_along_axis(near, apart.argsort(axis=1, kind="stable")[:, :MOST_NEIGHBOURS], True, axis=1)
    near &= apart < FAR
    near |= near.T
    length = np.where(near, (1 - 1e-9) * apart, apart)
    tree = length <= _shortest(length, np.maximum)  # no way round has only shorter edges: of the least spanning tree
    edges = np.ascontiguousarray(np.argwhere(np.triu(near | tree, 1)))  # else compiled loops are compiled twice
    return edges, by_door[edges[:, 0], edges[:, 1]]


def _hops(edges: Index, steps: Index, count: int) -> Index:
    """(G, G) lengths of the shortest paths; an edge counts 1 or 2."""
    hops = np.full((count, count), 2 * count)
    np.fill_diagonal(hops, 0)
    hops[edges[:, 0], edges[:, 1]] = hops[edges[:, 1], edges[:, 0]] = steps
    return _shortest(hops, np.add)


def _shortest(length: NDArray[Any], path: np.ufunc) -> NDArray[Any]:
    """(G, G) the least of all paths, given the lengths of the edges; that of a path is the sum, or the maximum, of its
    edges' (R. W. Floyd: Algorithm 97, Shortest path, 1962).
    """
    for k in range(len(length)):
        length = np.minimum(length, path(length[:, k, None], length[k]))
    return length
