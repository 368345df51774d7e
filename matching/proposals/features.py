"""The network's inputs: features of a scene graph's walls and rooms, their neighbours, and relative poses.

All features are relative: offsets in the frame of a wall surface (its inward normal, and its tangent to the left),
angles between normals, gaps, lengths. So they do not change when the graph is moved, but they do when it is mirrored.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.geometry.se2 import Array
from data.scene_graph import SceneGraph
from matching.arrays import Index, Walls, arrays, storeys
from matching.arrays.walls import points_along

Array32 = NDArray[np.float32]
NEIGHBOURS = 16  # of each node
SUPPORTERS = 10  # nearest walls of a wall with whose candidates its own are compared
ROOM_NEIGHBOURS = 5  # at most, of those of a room, are rooms; the others are its longest walls
THICKEST_M = 0.35  # of a wall whose two sides are marked as such
ACROSS_WAVES = (1.2, 3.0, 8.0, 20.0)  # metres: offsets across a wall are sharp,
ALONG_WAVES = (3.0, 8.0, 20.0)  # those along it are not: the ends of walls slide
GAP_SCALES = (0.3, 1.5)  # metres
SAMPLED_M, SEARCHED = 2.0, 48  # points on walls, among the nearest of which a wall's neighbours are looked up
TIES = 8  # more of them, if they are as near as the last one: rounding does not decide
NODE_SIZE = 9
EDGE_SIZE = 4 * (len(ACROSS_WAVES) + len(ALONG_WAVES)) + 8 + len(GAP_SCALES) + 5


@dataclass(frozen=True)
class GraphFeatures:
    """N wall surfaces and M rooms (those that have a wall), together V nodes, walls first.

    Positions are in the own frame of a storey: only differences within a storey may be used.
    """

    wall_ids: tuple[str, ...]  # (N)
    room_ids: tuple[str, ...]  # (M)
    node: Array32  # (V, NODE_SIZE)
    neighbour: Index  # (V, NEIGHBOURS) nodes, -1 where there are fewer; of a wall: the nearest walls, last its room
    edge: Array32  # (V, NEIGHBOURS, EDGE_SIZE) relative pose of each neighbour, 0 where there is none
    wall: Array32  # (N, 5) centre in metres, inward normal, half the length in metres or a guess of it
    room: Index  # (N,) the number of the wall's room, -1 where it is not known
    floor: Index  # (N,) the number of the wall's storey

    @property
    def near(self) -> Index:
        """(N, SUPPORTERS) the nearest walls of each wall, -1 where there are fewer."""
        return np.ascontiguousarray(self.neighbour[: len(self.wall), :SUPPORTERS])


def plan_features(a: SceneGraph) -> GraphFeatures:
    """Features of an A-graph of any number of storeys, with at least one wall surface."""
    return _features(storeys(a))


def map_features(s: SceneGraph, known: Walls | None = None) -> GraphFeatures:
    """Features of an S-graph with at least one wall surface, taken as one storey.

    `known` are its wall surfaces as arrays, if they are already computed.
    """
    return _features([known or arrays(s, None, list(s.wall_surfaces))])


@dataclass(frozen=True)
class _Nodes:
    """N walls and M rooms of all storeys, as V nodes; what rooms do not have is zero."""

    count: int  # N
    centre: Array  # (V, 2) a room's is the mean of its walls', by their lengths: a map's rooms have no footprint
    normal: Array  # (V, 2)
    tangent: Array  # (V, 2)
    half: Array  # (V,)
    known: Array  # (V,) whether the length was given
    room: Index  # (V,) the number of the wall's or the own room, -1 where not known

    @staticmethod
    def of(parts: list[Walls]) -> "_Nodes":
        rooms = sum(len(w.rooms) for w in parts)
        first = np.cumsum([0] + [len(w.rooms) for w in parts])
        room = np.concatenate([np.where(w.room >= 0, w.room + k, -1) for w, k in zip(parts, first, strict=False)])
        centre, half = np.concatenate([w.centre for w in parts]), np.concatenate([w.half for w in parts])
        inside = room >= 0
        weight = half[inside] + 0.1
        total = np.bincount(room[inside], weight, rooms)
        sums = [np.bincount(room[inside], weight * x, rooms) for x in centre[inside].T]
        none = np.zeros((rooms, 2))
        return _Nodes(
            len(half),
            np.concatenate((centre, np.stack(sums, axis=-1) / total[:, None])),
            np.concatenate((*(w.normal for w in parts), none)),
            np.concatenate((*(w.tangent for w in parts), none)),
            np.concatenate((half, none[:, 0])),
            np.concatenate((*(w.known for w in parts), none[:, 0])),
            np.concatenate((room, np.arange(rooms))),
        )


def _features(parts: list[Walls]) -> GraphFeatures:
    nodes = _Nodes.of(parts)
    n, first = nodes.count, np.cumsum([0] + [len(w) for w in parts])
    near = [nearest_walls(w, NEIGHBOURS - 1) for w in parts]
    nearest = np.concatenate([np.where(at >= 0, at + k, -1) for (at, _), k in zip(near, first, strict=False)])
    gap = np.concatenate([g for _, g in near])
    room = nodes.room[:n]
    neighbour = np.full((len(nodes.half), NEIGHBOURS), -1, dtype=np.int64)
    neighbour[:n, :-1], neighbour[:n, -1] = nearest, np.where(room >= 0, room + n, -1)
    _add_room_neighbours(nodes, nearest, gap, neighbour[n:])
    return GraphFeatures(
        sum((w.ids for w in parts), ()),
        tuple(r.id for w in parts for r in w.rooms),
        _node_features(nodes),
        neighbour,
        _edge_features(nodes, neighbour, gap),
        np.column_stack((nodes.centre, nodes.normal, nodes.half))[:n].astype(np.float32),
        room,
        np.repeat(np.arange(len(parts)), [len(w) for w in parts]),
    )


def nearest_walls(walls: Walls, size: int) -> tuple[Index, Array]:
    """Returns (N, size) the nearest other walls, -1 where there are fewer, and their gaps in metres.

    The gap is the distance from the nearest of one wall's ends and mid point to the other wall, the smaller of both
    directions. Only walls are ranked that have a point among the SEARCHED nearest points of the other one.
    """
    from scipy.spatial import cKDTree  # slow to import

    points, owner = points_along(
        walls.centre, walls.tangent, walls.half, 2 + np.ceil(2 * walls.half / SAMPLED_M).astype(np.int64)
    )
    away, near = cKDTree(points).query(points, min(SEARCHED + TIES, len(points)))
    point, k = np.nonzero(away <= away[:, :SEARCHED][:, -1:] + 1e-6)
    one, other = owner[point], owner[near[point, k]]
    pair = np.unique(np.concatenate((one * len(walls) + other, other * len(walls) + one)))
    i, j = np.divmod(pair, len(walls))
    i, j = i[i != j], j[i != j]
    offset = walls.centre[j] - walls.centre[i]
    gap = np.sqrt(np.minimum(_gap(walls, i, j, offset), _gap(walls, j, i, -offset)))
    # Walls that meet have no gap; other properties decide, so that rounding does not.
    beside = (offset * (walls.normal[i] + 2 * walls.tangent[i])).sum(axis=1)
    order, rank = _ranked(i, gap + 0.03 * np.hypot(*offset.T) + 0.001 * beside)
    order, rank = order[rank < size], rank[rank < size]
    nearest, gaps = np.full((len(walls), size), -1), np.full((len(walls), size), np.inf)
    nearest[i[order], rank], gaps[i[order], rank] = j[order], gap[order]
    return nearest, gaps


def _gap(walls: Walls, one: Index, other: Index, offset: Array) -> Array:
    """The squared distances in metres from the ends and mid points of other walls, at an offset from the centres of
    these walls, to these."""
    ends = offset + np.array([-1.0, 0.0, 1.0])[:, None, None] * (walls.half[:, None] * walls.tangent)[other]
    past = np.maximum(np.abs((ends * walls.tangent[one]).sum(axis=-1)) - walls.half[one], 0.0)
    return np.asarray(((ends * walls.normal[one]).sum(axis=-1) ** 2 + past**2).min(axis=0))


def _ranked(group: Index, *keys: Array | Index) -> tuple[Index, Index]:
    """The order by group, then by keys, and the rank within its group of each in that order; ties keep their order."""
    order = np.lexsort((*keys[::-1], group))
    ordered = group[order]
    return order, np.arange(len(order)) - np.searchsorted(ordered, ordered)


def _add_room_neighbours(nodes: _Nodes, nearest: Index, gap: Array, neighbour: Index) -> None:
    """Writes the neighbours (M, NEIGHBOURS) of rooms: the longest walls, then the rooms behind their walls.

    `nearest` and `gap` (N, k) are the walls that are nearest to each wall, and how far away they are, in metres.
    """
    n, room = nodes.count, nodes.room
    wall = np.flatnonzero(room[:n] >= 0)
    offset = nodes.centre[room[wall] + n] - nodes.centre[wall]
    beside = (offset * (nodes.normal[wall] + 2 * nodes.tangent[wall])).sum(axis=1)  # decides between equal lengths
    order, rank = _ranked(room[wall], 0.01 * beside - nodes.half[wall])
    wall, rank = wall[order][kept := rank < NEIGHBOURS - ROOM_NEIGHBOURS], rank[kept]
    neighbour[room[wall], rank] = wall
    walls = np.bincount(room[wall], minlength=len(neighbour))

    i, k = np.nonzero((nearest >= 0) & (room[:n] >= 0)[:, None])
    r, q = room[i], room[nearest[i, k]]
    other = (q >= 0) & (q != r)
    r, q, apart = r[other], q[other], gap[i, k][other]
    cost = apart + 0.1 * np.hypot(*(nodes.centre[q + n] - nodes.centre[r + n]).T)
    order = np.lexsort((cost, q, r))
    order = order[np.unique(r[order] * len(neighbour) + q[order], return_index=True)[1]]  # the least of each two rooms
    r, q, cost = r[order], q[order], cost[order]
    order, rank = _ranked(r, cost, q)
    r, q, rank = r[order][kept := rank < ROOM_NEIGHBOURS], q[order][kept], rank[kept]
    neighbour[r, walls[r] + rank] = q + n


def _node_features(nodes: _Nodes) -> Array32:
    """(V, NODE_SIZE): is a wall, length known, length, its log, has a room; is a room, two extents, number of walls.

    The extents of a room are along and across its longest wall.
    """
    n, m, room = nodes.count, len(nodes.half) - nodes.count, nodes.room
    length = 2 * nodes.half[:n]
    node = np.zeros((n + m, NODE_SIZE), dtype=np.float32)
    node[:n, 0], node[:n, 1] = 1.0, nodes.known[:n]
    node[:n, 2], node[:n, 3] = np.minimum(length, 20.0) / 5, np.log(length + 0.1)
    node[:n, 4] = room[:n] >= 0
    wall = np.flatnonzero(room[:n] >= 0)
    order, rank = _ranked(room[wall], -nodes.half[wall])
    longest = wall[order[rank == 0]][room[wall]]
    reach = nodes.half[wall, None] * nodes.tangent[wall]
    node[n:, 5] = 1.0
    for column, axis in ((6, nodes.tangent[longest]), (7, nodes.normal[longest])):
        low, high = np.full(m, np.inf), np.full(m, -np.inf)
        for end in (nodes.centre[wall] - reach, nodes.centre[wall] + reach):
            along = (end * axis).sum(axis=1)
            np.minimum.at(low, room[wall], along)
            np.maximum.at(high, room[wall], along)
        node[n:, column] = (high - low) / 5
    node[n:, 8] = np.bincount(room[wall], minlength=m) / 6
    return node


def _edge_features(nodes: _Nodes, neighbour: Index, gap: Array) -> Array32:
    """(V, NEIGHBOURS, EDGE_SIZE) relative pose of each neighbour; zero where there is none.

    Offsets are in the frames of those of the two that are walls; angles and gaps of rooms are zero.
    """
    i, k = np.nonzero(neighbour >= 0)
    j, n = neighbour[i, k], nodes.count
    offset = nodes.centre[j] - nodes.centre[i]

    def dot(one: Array, other: Array) -> Array:
        return np.asarray((one * other).sum(axis=1))

    across = np.stack((dot(offset, nodes.normal[i]), -dot(offset, nodes.normal[j])), axis=-1)
    along = np.stack((dot(offset, nodes.tangent[i]), -dot(offset, nodes.tangent[j])), axis=-1)
    turns = [across[:, :, None] / ACROSS_WAVES, along[:, :, None] / ALONG_WAVES]
    phase = 2 * np.pi * np.concatenate([x.reshape(len(i), 2 * x.shape[2]) for x in turns], axis=1)
    waves = np.stack((np.sin(phase), np.cos(phase)), axis=-1).reshape(len(i), 2 * phase.shape[1])

    cos = dot(nodes.normal[i], nodes.normal[j])
    wall_i, wall_j = i < n, j < n
    both = wall_i & wall_j
    apart = np.hypot(*offset.T)
    apart[both] = gap[i[both], k[both]]
    half_i, half_j = nodes.half[i], nodes.half[j]
    overlap = np.abs(along[:, 0]) < half_i + half_j
    sides = both & (cos < -0.9) & (across[:, 0] > -THICKEST_M) & (across[:, 0] < 0) & overlap
    columns = [cos, dot(nodes.tangent[i], nodes.normal[j]), np.minimum(half_j, 10.0) / 2.5, nodes.known[j]]
    columns += [np.exp(-apart / scale) for scale in GAP_SCALES]
    same_room = (nodes.room[i] == nodes.room[j]) & (nodes.room[i] >= 0)
    columns += [x.astype(float) for x in (same_room, sides, both, wall_i & ~wall_j, ~wall_i & wall_j)]
    edge = np.zeros((*neighbour.shape, EDGE_SIZE), dtype=np.float32)
    clipped = np.clip(np.hstack((across, along)) / 5, -4.0, 4.0)
    edge[i, k] = np.hstack((waves, clipped, np.stack(columns, axis=-1)))
    return edge
