"""The network's input features: nodes of a scene graph, their neighbours, and relative poses.

All features are relative: offsets in the frame of a wall surface (its inward normal, and its tangent to the left),
angles between normals, gaps, lengths. So they do not change when the graph is moved, but they do when it is mirrored.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from data.geometry.se2 import Array
from data.scene_graph import SceneGraph
from matching.arrays import Index, Walls, arrays, storeys
from matching.arrays.neighbours import nearest_walls

Array32 = NDArray[np.float32]
NEIGHBOURS = 16  # of each node
ROOM_NEIGHBOURS = 5  # of them at most, of a room, are rooms; the others are its longest walls
THICKEST_M = 0.35  # m, of a wall whose two sides are marked as such
ACROSS_WAVES = (1.2, 3.0, 8.0, 20.0)  # metres: offsets across a wall are sharp,
ALONG_WAVES = (3.0, 8.0, 20.0)  # those along it are not: the ends of walls slide
GAP_SCALES = (0.3, 1.5)  # metres
NODE_SIZE = 9
EDGE_SIZE = 2 * (2 * len(ACROSS_WAVES) + 2 * len(ALONG_WAVES)) + 4 + 2 + 2 + len(GAP_SCALES) + 2 + 3
WAVES = 2 * (len(ACROSS_WAVES) + len(ALONG_WAVES))


@dataclass(frozen=True)
class GraphFeatures:
    """N wall surfaces and M rooms (those that have one), together V nodes.

    `centre` and `heading` are in the storey's own frame; only differences within a storey may be used.
    """

    walls: tuple[str, ...]  # (N) ids
    rooms: tuple[str, ...]  # (M)
    wall_node: Index  # (N,)
    room_node: Index  # (M,)
    centre: Array32  # (V, 2) metres; a room's is the mean of its walls' by their lengths
    heading: Array32  # (V,) radians, of the inward normal; zero for rooms
    half: Array32  # (V,) metres, half the length or a guess of it; zero for rooms
    home: Index  # (V,) the node of a wall's room, -1 where not known and for rooms
    floor: Index  # (V,) a number for each storey
    node: Array32  # (V, NODE_SIZE)
    neighbour: Index  # (V, NEIGHBOURS) nodes, nearest first, walls before rooms; -1 where there are fewer
    edge: Array32  # (V, NEIGHBOURS, EDGE_SIZE)

    def __len__(self) -> int:
        return len(self.centre)


@dataclass(frozen=True)
class PairRows:
    """Which rows of a batch's walls and rooms belong to one pair of graphs: (first, last + 1)."""

    s_walls: tuple[int, int]
    a_walls: tuple[int, int]
    s_rooms: tuple[int, int]
    a_rooms: tuple[int, int]


def plan_features(a: SceneGraph) -> GraphFeatures:
    """Features of an A-graph of any number of storeys."""
    return joined([_features(w, f) for f, w in enumerate(storeys(a))])


def map_features(s: SceneGraph, known: Walls | None = None) -> GraphFeatures:
    """Features of an S-graph, taken as one storey; `known` are its surfaces as arrays, if already computed."""
    if not s.wall_surfaces:
        return joined([])
    return joined([_features(known or arrays(s, None, list(s.wall_surfaces)), 0)])


def _features(walls: Walls, floor: int) -> GraphFeatures:
    n, m = len(walls), len(walls.rooms)
    home = np.where(walls.room >= 0, walls.room + n, -1)
    nearest, near = nearest_walls(walls, NEIGHBOURS - 1)
    centre = np.concatenate((walls.centre, _room_centres(walls)))
    beside = _rooms_beside(walls.room, nearest, near, centre[n:])
    neighbour = np.full((n + m, NEIGHBOURS), -1, dtype=np.int64)
    gap = np.full(neighbour.shape, np.inf)
    neighbour[:n, :-1], gap[:n, :-1] = nearest, near
    neighbour[:n, -1] = home
    _of_rooms(walls.room, walls.half, walls.centre, walls.normal, walls.tangent, centre[n:], beside, neighbour[n:])
    edge = _edges(walls, centre, home, neighbour, gap)
    return GraphFeatures(
        walls.ids, tuple(r.id for r in walls.rooms), np.arange(n), np.arange(n, n + m), centre.astype(np.float32),
        _pad(walls.heading, m), _pad(walls.half, m), np.concatenate((home, np.full(m, -1))),
        np.full(n + m, floor), _nodes(walls), neighbour, edge,
    )  # fmt: skip


def _pad(values: Array, rooms: int) -> Array32:
    return np.concatenate((values, np.zeros(rooms))).astype(np.float32)


@compiled
def _rooms_beside(room: Index, nearest: Index, gap: Array, centre: Array) -> Index:
    """(M, ROOM_NEIGHBOURS) the rooms whose walls are neighbours of each room's walls, nearest first, -1 for none.

    `room` (N,), `nearest` and `gap` (N, k) describe the walls, `centre` (M, 2) the rooms.
    """
    beside = np.full((len(centre), ROOM_NEIGHBOURS), -1)
    cost = np.full(beside.shape, np.inf)
    for i in range(len(room)):
        for k in range(nearest.shape[1] if room[i] >= 0 else 0):
            r, q = room[i], room[nearest[i, k]]
            if nearest[i, k] < 0 or q < 0 or q == r:
                continue
            new = gap[i, k] + 0.1 * np.hypot(centre[q, 0] - centre[r, 0], centre[q, 1] - centre[r, 1])
            at = 0  # where it is known already, or the last place
            while at < ROOM_NEIGHBOURS - 1 and beside[r, at] != q:
                at += 1
            if not (new < cost[r, at] or (new == cost[r, at] and q < beside[r, at])):
                continue
            while at > 0 and (new < cost[r, at - 1] or (new == cost[r, at - 1] and q < beside[r, at - 1])):
                beside[r, at], cost[r, at] = beside[r, at - 1], cost[r, at - 1]
                at -= 1
            beside[r, at], cost[r, at] = q, new
    return beside


def _room_centres(walls: Walls) -> Array:
    """(M, 2) means of the walls, computed alike in both graphs, since a map's rooms have no footprint."""
    with_room = walls.room >= 0
    weight = walls.half[with_room] + 0.1
    total = np.bincount(walls.room[with_room], weight, len(walls.rooms))
    sums = [np.bincount(walls.room[with_room], weight * walls.centre[with_room, k], len(walls.rooms)) for k in (0, 1)]
    return np.stack(sums, axis=-1) / total[:, None]


def _nodes(walls: Walls) -> Array32:
    """(N + M, NODE_SIZE): is a wall, length known, length, its log, has a room; is a room, extents, walls."""
    n, m = len(walls), len(walls.rooms)
    node = np.zeros((n + m, NODE_SIZE), dtype=np.float32)
    length = 2 * walls.half
    node[:n, 0] = 1.0
    node[:n, 1] = walls.known
    node[:n, 2] = np.minimum(length, 20.0) / 5
    node[:n, 3] = np.log(length + 0.1)
    node[:n, 4] = walls.room >= 0
    node[n:, 5] = 1.0
    _extents(walls.room, walls.half, walls.centre, walls.normal, walls.tangent, node[n:])
    return node


@compiled
def _of_rooms(
    room: Index, half: Array, centre: Array, normal: Array, tangent: Array, of_room: Array, beside: Index,
    neighbour: Index,
) -> None:  # fmt: skip
    """Writes the neighbours (M, NEIGHBOURS) of rooms with their centres (M, 2): the longest walls, then rooms."""
    most, n = NEIGHBOURS - ROOM_NEIGHBOURS, len(half)
    cost = np.empty((len(of_room), most))
    count = np.zeros(len(of_room), dtype=np.int64)
    for i in range(n):
        r = room[i]
        if r < 0:
            continue
        x, y = of_room[r, 0] - centre[i, 0], of_room[r, 1] - centre[i, 1]
        new = x * (normal[i, 0] + 2 * tangent[i, 0]) + y * (normal[i, 1] + 2 * tangent[i, 1])
        new = 0.01 * new - half[i]
        at = count[r]
        while at > 0 and new < cost[r, at - 1]:
            if at < most:
                cost[r, at], neighbour[r, at] = cost[r, at - 1], neighbour[r, at - 1]
            at -= 1
        if at < most:
            cost[r, at], neighbour[r, at] = new, i
            count[r] = min(count[r] + 1, most)
    for r in range(len(of_room)):
        for q in beside[r]:
            if q >= 0:
                neighbour[r, count[r]] = n + q
                count[r] += 1


@compiled
def _extents(room: Index, half: Array, centre: Array, normal: Array, tangent: Array, node: Array32) -> None:
    """Writes the last columns of `_nodes`: rooms' extents along and across their longest wall, and walls."""
    longest, end = np.full(len(node), -1), np.empty(2)
    low, high = np.full((len(node), 2), np.inf), np.full((len(node), 2), -np.inf)
    for i in range(len(half)):
        r = room[i]
        if r >= 0 and (longest[r] < 0 or half[i] > half[longest[r]]):
            longest[r] = i
    for i in range(len(half)):
        r = room[i]
        for side in range(2 if r >= 0 else 0):
            end[0] = centre[i, 0] + (2 * side - 1) * half[i] * tangent[i, 0]
            end[1] = centre[i, 1] + (2 * side - 1) * half[i] * tangent[i, 1]
            along = end[0] * tangent[longest[r], 0] + end[1] * tangent[longest[r], 1]
            across = end[0] * normal[longest[r], 0] + end[1] * normal[longest[r], 1]
            low[r, 0], high[r, 0] = min(low[r, 0], along), max(high[r, 0], along)
            low[r, 1], high[r, 1] = min(low[r, 1], across), max(high[r, 1], across)
            node[r, 8] += 0.5
    for r in range(len(node)):
        node[r, 6], node[r, 7], node[r, 8] = (high[r, 0] - low[r, 0]) / 5, (high[r, 1] - low[r, 1]) / 5, node[r, 8] / 6


def _edges(walls: Walls, centre: Array, home: Index, neighbour: Index, gap: Array) -> Array32:
    """(V, NEIGHBOURS, EDGE_SIZE) relative pose of each neighbour; zero where there is none.

    Offsets are in the frames of those of the two that are walls; angles and gaps of rooms are zero.
    """
    rooms = len(centre) - len(walls)
    none = np.zeros((rooms, 2))
    edge = np.zeros((*neighbour.shape, EDGE_SIZE), dtype=np.float32)
    phase = np.zeros((*neighbour.shape, WAVES), dtype=np.float32)
    _relations(
        len(walls), centre, np.concatenate((walls.normal, none)), np.concatenate((walls.tangent, none)),
        np.concatenate((walls.half, none[:, 0])), np.concatenate((walls.known, none[:, 0])),
        np.concatenate((home, np.arange(len(walls), len(centre)))), neighbour, gap, phase, edge,
    )  # fmt: skip
    edge[..., 0 : 2 * WAVES : 2] = np.sin(phase)
    edge[..., 1 : 2 * WAVES : 2] = np.cos(phase)
    edge[neighbour < 0] = 0
    return edge


@compiled
def _relations(
    n: int, centre: Array, normal: Array, tangent: Array, half: Array, known: Array, room: Index,
    neighbour: Index, gap: Array, phase: Array32, edge: Array32,
) -> None:  # fmt: skip
    """Writes the columns of `_edges` for nodes of which the first n are walls; of waves only the phase, in (-pi,
    pi].
    """
    for i in range(len(centre)):
        for k in range(neighbour.shape[1]):
            j = neighbour[i, k]
            if j < 0:
                continue
            x, y = centre[j, 0] - centre[i, 0], centre[j, 1] - centre[i, 1]
            across = x * normal[i, 0] + y * normal[i, 1], -(x * normal[j, 0] + y * normal[j, 1])
            along = x * tangent[i, 0] + y * tangent[i, 1], -(x * tangent[j, 0] + y * tangent[j, 1])
            at = 0
            for offset in across:
                for length in ACROSS_WAVES:
                    phase[i, k, at] = 2 * np.pi * (offset / length - np.rint(offset / length))
                    at += 1
            for offset in along:
                for length in ALONG_WAVES:
                    phase[i, k, at] = 2 * np.pi * (offset / length - np.rint(offset / length))
                    at += 1
            row = edge[i, k, 2 * at :]
            cos = normal[i, 0] * normal[j, 0] + normal[i, 1] * normal[j, 1]
            both = i < n and j < n
            apart = gap[i, k] if both else np.hypot(x, y)
            overlap = abs(along[0]) < half[i] + half[j]
            for c in range(2):
                row[c] = min(max(across[c] / 5, -4.0), 4.0)
                row[2 + c] = min(max(along[c] / 5, -4.0), 4.0)
            row[4], row[5] = cos, tangent[i, 0] * normal[j, 0] + tangent[i, 1] * normal[j, 1]
            row[6], row[7] = min(half[j], 10.0) / 2.5, known[j]
            at = 8
            for scale in GAP_SCALES:
                row[at] = np.exp(-apart / scale)
                at += 1
            row[at] = room[i] == room[j] and room[i] >= 0
            row[at + 1] = both and cos < -0.9 and -THICKEST_M < across[0] < 0 and overlap
            row[at + 2], row[at + 3], row[at + 4] = both, i < n and j >= n, i >= n and j < n


def joined(parts: list[GraphFeatures]) -> GraphFeatures:
    """Joins several graphs (storeys of one, or pairs of a batch) into one, without edges between them."""
    parts = parts or [_nothing()]
    if len(parts) == 1:
        return parts[0]
    first = np.cumsum([0] + [len(p) for p in parts[:-1]])
    floors = np.cumsum([0] + [int(p.floor.max(initial=-1)) + 1 for p in parts[:-1]])

    def stack(name: str) -> NDArray[Any]:
        return np.concatenate([getattr(p, name) for p in parts])

    def nodes(name: str) -> Index:
        rows = [getattr(p, name) for p in parts]
        return np.concatenate([np.where(x >= 0, x + k, -1) for x, k in zip(rows, first, strict=True)])

    return GraphFeatures(
        sum((p.walls for p in parts), ()), sum((p.rooms for p in parts), ()), nodes("wall_node"), nodes("room_node"),
        stack("centre"), stack("heading"), stack("half"), nodes("home"),
        np.concatenate([p.floor + k for p, k in zip(parts, floors, strict=True)]), stack("node"),
        nodes("neighbour"), stack("edge"),
    )  # fmt: skip


def _nothing() -> GraphFeatures:
    def none(*shape: int) -> Array32:
        return np.zeros((0, *shape), dtype=np.float32)

    index = np.zeros(0, dtype=np.int64)
    return GraphFeatures(
        (), (), index, index, none(2), none(), none(), index, index, none(NODE_SIZE),
        np.zeros((0, NEIGHBOURS), dtype=np.int64), none(NEIGHBOURS, EDGE_SIZE),
    )  # fmt: skip
