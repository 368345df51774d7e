"""A scene graph as what the network sees: nodes, their neighbours, and how these lie to each other.

Everything that the network is given is relative: offsets in the frame of a wall surface (its inward normal, and
its tangent to the left), angles between normals, gaps, lengths. So a graph may be moved at will, not mirrored.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data.compiled import compiled
from data.scene_graph import SceneGraph
from matching.se2 import Array
from matching.walls import Index, Walls, arrays, storeys

Array32 = NDArray[np.float32]
NEIGHBOURS = 16  # of each node
ROOM_NEIGHBOURS = 5  # of them at most, of a room, are rooms; the others are its longest walls
THICKEST_M = 0.35  # wall whose two sides are told to be such
ACROSS_WAVES = (1.2, 3.0, 8.0, 20.0)  # metres: offsets across a wall are sharp,
ALONG_WAVES = (3.0, 8.0, 20.0)  # those along it are not: the ends of walls slide
GAP_SCALES = (0.3, 1.5)  # metres
NODE_SIZE = 9
EDGE_SIZE = 2 * (2 * len(ACROSS_WAVES) + 2 * len(ALONG_WAVES)) + 4 + 2 + 2 + len(GAP_SCALES) + 2 + 3
MOST_DENSE = 1 << 22  # pairs of walls for which a table is kept
SAMPLED_M, SEARCHED = 2.0, 48  # points on walls, among the nearest of which the neighbours are looked up


@dataclass(frozen=True)
class GraphFeatures:
    """N wall surfaces and M rooms (those that have one), together V nodes.

    `centre` and `heading` are in a frame of the storey's own: only differences within a storey may be used.
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


def map_features(s: SceneGraph) -> GraphFeatures:
    """Features of an S-graph, all taken as one storey."""
    surfaces = list(s.wall_surfaces)
    return joined([_features(arrays(s, None, surfaces), 0)] if surfaces else [])


def _features(walls: Walls, floor: int) -> GraphFeatures:
    n, m = len(walls), len(walls.rooms)
    home = np.where(walls.room >= 0, walls.room + n, -1)
    nearest, near = _nearest_walls(walls)
    centre = np.concatenate((walls.centre, _room_centres(walls)))
    beside = _rooms_beside(walls, nearest, near, centre[n:])
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


def _nearest_walls(walls: Walls) -> tuple[Index, Array]:
    """(N, NEIGHBOURS - 1) the nearest other walls, -1 where there are fewer, and their gaps in metres.

    The gap is from the nearer of one wall's ends and mid point to the other wall, the lesser way round.
    """
    from scipy.spatial import cKDTree  # slow to import

    n = len(walls)
    owner = np.repeat(np.arange(n), 2 + np.ceil(2 * walls.half / SAMPLED_M).astype(np.int64))
    first = np.searchsorted(owner, np.arange(n))
    share = (np.arange(len(owner)) - first[owner]) / (np.bincount(owner)[owner] - 1) * 2 - 1
    points = walls.centre[owner] + (share * walls.half[owner])[:, None] * walls.tangent[owner]
    near = cKDTree(points).query(points, min(SEARCHED, len(points)))[1].reshape(len(points), -1)
    i, j = _joined_walls(owner, owner[near], n)
    return _ranked(i, j, walls.centre, walls.normal, walls.tangent, walls.half)


@compiled
def _ranked(i: Index, j: Index, centre: Array, normal: Array, tangent: Array, half: Array) -> tuple[Index, Array]:
    """Of pairs of walls (P,) those of each wall, nearest first: (N, NEIGHBOURS - 1), and their gaps."""
    walls, size = len(half), NEIGHBOURS - 1
    nearest, gaps, cost = np.full((walls, size), -1), np.full((walls, size), np.inf), np.full((walls, size), np.inf)
    for back in (False, True):
        for pair in range(len(i)):
            one, other = (j[pair], i[pair]) if back else (i[pair], j[pair])
            x, y = centre[other, 0] - centre[one, 0], centre[other, 1] - centre[one, 1]
            gap = min(_gap(x, y, one, other, normal, tangent, half), _gap(-x, -y, other, one, normal, tangent, half))
            # Walls that meet have no gap at all: what else they have decides, so that the choice is no matter of
            # rounding.
            side = x * (normal[one, 0] + 2 * tangent[one, 0]) + y * (normal[one, 1] + 2 * tangent[one, 1])
            new = gap + 0.03 * np.hypot(x, y) + 0.001 * side
            at = size
            while at > 0 and new < cost[one, at - 1]:
                at -= 1
                if at + 1 < size:
                    nearest[one, at + 1], gaps[one, at + 1] = nearest[one, at], gaps[one, at]
                    cost[one, at + 1] = cost[one, at]
            if at < size:
                nearest[one, at], gaps[one, at], cost[one, at] = other, gap, new
    return nearest, gaps


@compiled
def _gap(x: float, y: float, one: int, other: int, normal: Array, tangent: Array, half: Array) -> float:
    """Metres from the ends and the mid point of another wall, which lies at (x, y) from a wall's centre, to this."""
    least = np.inf
    for side in (-1, 0, 1):
        u, v = x + side * half[other] * tangent[other, 0], y + side * half[other] * tangent[other, 1]
        past = max(abs(u * tangent[one, 0] + v * tangent[one, 1]) - half[one], 0.0)
        least = min(least, np.hypot(u * normal[one, 0] + v * normal[one, 1], past))
    return least


def _joined_walls(one: Index, others: Index, count: int) -> tuple[Index, Index]:
    """Each pair of different walls once that `one` (P,) and `others` (P, k) name, whichever way round."""
    if count * count <= MOST_DENSE:
        near = np.zeros((count, count), dtype=bool)
        near[one[:, None], others] = True
        i, j = np.nonzero(np.triu(near | near.T, 1))
        return i, j
    low, high = np.minimum(one[:, None], others), np.maximum(one[:, None], others)
    pair = np.unique((low * count + high)[low < high])
    return pair // count, pair % count


def _rooms_beside(walls: Walls, nearest: Index, gap: Array, centre: Array) -> Index:
    """(M, ROOM_NEIGHBOURS) for each room those whose walls are neighbours of its own, nearest first, -1 for none."""
    m = len(walls.rooms)
    i, k = np.nonzero(nearest >= 0)
    r, q = walls.room[i], walls.room[nearest[i, k]]
    other = (r >= 0) & (q >= 0) & (q != r)
    r, q, apart = r[other], q[other], gap[i[other], k[other]]
    away = centre[q] - centre[r]
    apart = apart + 0.1 * np.hypot(away[:, 0], away[:, 1])
    order = np.lexsort((apart, q, r))
    first = order[np.append(True, np.diff((r * m + q)[order]) != 0)[: len(order)]]
    order = first[np.lexsort((apart[first], r[first]))]
    r, q = r[order], q[order]
    rank = np.arange(len(r)) - np.searchsorted(r, r)
    beside = np.full((m, ROOM_NEIGHBOURS), -1)
    kept = rank < ROOM_NEIGHBOURS
    beside[r[kept], rank[kept]] = q[kept]
    return beside


def _room_centres(walls: Walls) -> Array:
    """(M, 2) the same in both graphs: a map's room has no footprint."""
    housed = walls.room >= 0
    weight = walls.half[housed] + 0.1
    total = np.bincount(walls.room[housed], weight, len(walls.rooms))
    sums = [np.bincount(walls.room[housed], weight * walls.centre[housed, k], len(walls.rooms)) for k in (0, 1)]
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
    """(V, NEIGHBOURS, EDGE_SIZE) how each neighbour lies to the node; zero where there is none.

    Offsets in the frames of those of the two that are walls; a room has none, its angles and gaps are zero.
    """
    n, v = len(walls), len(centre)
    normal = np.concatenate((walls.normal, np.zeros((v - n, 2))))
    tangent = np.concatenate((walls.tangent, np.zeros((v - n, 2))))
    half = np.concatenate((walls.half, np.zeros(v - n)))
    known = np.concatenate((walls.known, np.zeros(v - n)))
    room = np.where(np.arange(v) < n, np.concatenate((home, np.zeros(v - n))), np.arange(v))
    i, j = np.broadcast_to(np.arange(v)[:, None], neighbour.shape), np.maximum(neighbour, 0)
    away = centre[j] - centre[i]
    across = [np.sum(away * normal[i], axis=-1), -np.sum(away * normal[j], axis=-1)]
    along = [np.sum(away * tangent[i], axis=-1), -np.sum(away * tangent[j], axis=-1)]
    both = (i < n) & (j < n)
    cos, sin = np.sum(normal[i] * normal[j], axis=-1), np.sum(tangent[i] * normal[j], axis=-1)
    apart = np.where(both, gap, np.hypot(away[..., 0], away[..., 1]))
    same = (room[i] == room[j]) & (room[i] >= 0)
    overlap = np.abs(along[0]) < half[i] + half[j]
    facing = both & (cos < -0.9) & (across[0] < 0) & (across[0] > -THICKEST_M) & overlap
    columns: list[NDArray[Any]] = [*_waves(across, ACROSS_WAVES), *_waves(along, ALONG_WAVES)]
    columns += [np.clip(d / 5, -4, 4) for d in (*across, *along)]
    columns += [cos, sin, np.minimum(half[j], 10.0) / 2.5, known[j], *(np.exp(-apart / g) for g in GAP_SCALES)]
    columns += [same, facing, both, (i < n) & (j >= n), (i >= n) & (j < n)]
    edge = np.empty((*neighbour.shape, EDGE_SIZE), dtype=np.float32)
    for k, column in enumerate(columns):
        edge[..., k] = column
    edge[neighbour < 0] = 0
    return edge


def _waves(offsets: list[Array], lengths: tuple[float, ...]) -> Array32:
    """Sine, then cosine, for each length, for each offset; in single precision once whole waves are taken off."""
    turns = np.array(offsets)[:, None] / np.array(lengths)[:, None, None]
    phase = (2 * np.pi * (turns - np.rint(turns))).astype(np.float32)
    waves = np.stack((np.sin(phase), np.cos(phase)), axis=2)
    return waves.reshape(-1, *waves.shape[3:])


def joined(parts: list[GraphFeatures]) -> GraphFeatures:
    """Several graphs (storeys of one, or pairs of a batch) as one, without a neighbour in common."""
    parts = parts or [_nothing()]
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
