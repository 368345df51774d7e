"""The parts of a map that are taken as rigid, the rooms, and which of them lie side by side."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from matching.hypotheses import groups_of
from matching.se2 import Array
from matching.walls import Index, Walls

BESIDE = 0.8  # metres between the walls of neighbours: a wall's thickness and its errors
POINTS = 0.5  # metres between points of a wall
BEHIND = 1.0  # metres that a room behind a stray wall counts as further away
MOST_NEIGHBOURS = 6
NO_DOOR = 2.5  # slack between neighbours of whom no door is known


@dataclass(frozen=True)
class Groups:
    """G parts of a map. `edges` join neighbours and make one connected whole."""

    of_wall: Index  # (Ns,)
    centre: Array  # (G, 2) mean of the walls' centres
    edges: Index  # (E, 2)
    slack: Array  # (E,) how much more the motions may differ than from a room through a door into the next
    hops: Index  # (G, G) steps from one to another; one that is not through a door counts twice

    def __len__(self) -> int:
        return len(self.centre)


def groups(s: Walls, doors: Iterable[Sequence[str]] = ()) -> Groups:
    """The groups of a map with at least one wall; `doors` are the ids of the rooms that they join."""
    of_wall = _of_wall(s)
    size = np.bincount(of_wall)
    centre = np.stack([np.bincount(of_wall, s.centre[:, k]) / size for k in (0, 1)], axis=-1)
    joined = _joined(s, of_wall, doors)
    edges = _edges(s, of_wall, centre, joined)
    by_door = np.array([(g, h) in joined for g, h in edges.tolist()], dtype=bool)
    slack = np.where(by_door, 1.0, NO_DOOR)
    steps = np.where(by_door | (not joined), 1, 2)
    return Groups(of_wall, centre, edges, slack, _hops(edges, steps, len(size)))


def _joined(s: Walls, of_wall: Index, doors: Iterable[Sequence[str]]) -> set[tuple[int, int]]:
    """Which groups a door joins, the lesser number first."""
    group = {s.rooms[r].id: int(g) for r, g in zip(s.room.tolist(), of_wall.tolist(), strict=True) if r >= 0}
    found = set()
    for rooms in doors:
        ends = sorted({group[r] for r in rooms if r in group})
        found |= {(g, h) for g in ends for h in ends if g < h}
    return found


def _of_wall(s: Walls) -> Index:
    """A wall without a room goes with the nearest room on the side that it faces."""
    stray, housed = s.room < 0, np.nonzero(s.room >= 0)[0]
    if not stray.any() or not len(housed):
        return groups_of(s)
    size = np.bincount(s.room[housed], minlength=len(s.rooms))
    middle = np.stack([np.bincount(s.room[housed], s.centre[housed, k], len(s.rooms)) / size for k in (0, 1)], axis=-1)
    step = s.centre[housed][None] - s.centre[stray][:, None]
    towards = middle[s.room[housed]][None] - s.centre[stray][:, None]
    behind = np.einsum("ijk,ik->ij", towards, s.normal[stray]) < 0
    near = np.argmin(np.linalg.norm(step, axis=-1) + BEHIND * behind, axis=1)
    room = s.room.copy()
    room[stray] = s.room[housed[near]]
    return np.asarray(np.unique(room, return_inverse=True)[1])


def _gaps(s: Walls, of_wall: Index) -> tuple[Index, Array]:
    """(E, 2) groups whose walls are near each other, and (E,) the metres between them, roughly."""
    from scipy.spatial import cKDTree  # slow to import

    count = np.maximum(np.ceil(2 * s.half / POINTS).astype(np.int64), 1)
    wall = np.repeat(np.arange(len(s)), count)
    place = (np.arange(len(wall)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[wall]
    points = s.centre[wall] + ((2 * place - 1) * s.half[wall])[:, None] * s.tangent[wall]
    pairs = cKDTree(points).query_pairs(BESIDE + POINTS / 2, output_type="ndarray")
    ends = np.sort(of_wall[wall[pairs]], axis=1)
    apart = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=-1)
    other = ends[:, 0] != ends[:, 1]
    near, inverse = np.unique(ends[other], axis=0, return_inverse=True)
    gap = np.full(len(near), np.inf)
    np.minimum.at(gap, inverse.reshape(-1), apart[other])
    return near.reshape(-1, 2), gap


def _edges(s: Walls, of_wall: Index, centre: Array, doors: set[tuple[int, int]]) -> Index:
    """(E, 2) the doors' pairs, near ones, and what joins all."""
    from scipy.sparse.csgraph import minimum_spanning_tree

    near, gap = _gaps(s, of_wall)
    apart = 10 + np.linalg.norm(centre[:, None] - centre[None], axis=-1)
    apart[near[:, 0], near[:, 1]] = apart[near[:, 1], near[:, 0]] = gap
    for g, h in doors:
        apart[g, h] = apart[h, g] = 1e-6
    np.fill_diagonal(apart, np.inf)
    tree = minimum_spanning_tree(np.where(np.isfinite(apart), apart, 0.0)).toarray() > 0
    ordered = np.argsort(apart, axis=1, kind="stable")[:, :MOST_NEIGHBOURS]
    kept = np.zeros(apart.shape, dtype=bool)
    np.put_along_axis(kept, ordered, np.take_along_axis(apart, ordered, axis=1) < 10, axis=1)
    return np.stack(np.nonzero(np.triu(kept | kept.T | tree | tree.T, 1)), axis=-1)


def _hops(edges: Index, steps: Index, count: int) -> Index:
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import shortest_path

    graph = csr_matrix((steps.astype(float), (edges[:, 0], edges[:, 1])), shape=(count, count))
    return np.asarray(shortest_path(graph, directed=False)).astype(np.int64)
