"""The parts of a map that are taken as rigid, the rooms, and which of them lie side by side."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from matching.hypotheses import groups_of
from matching.se2 import Array
from matching.walls import Index, Walls

BESIDE = 0.8  # metres between the walls of neighbours: a wall's thickness and its errors
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
    edges = _edges(np.where(joined, 0.0, _gaps(s, of_wall)), joined)
    by_door = joined[edges[:, 0], edges[:, 1]]
    slack = np.where(by_door, 1.0, NO_DOOR)
    return Groups(of_wall, centre, edges, slack, _hops(edges, np.where(by_door | ~joined.any(), 1, 2), len(size)))


def _joined(s: Walls, of_wall: Index, doors: Iterable[Sequence[str]]) -> NDArray[np.bool_]:
    """(G, G) which groups a door joins."""
    group = {s.rooms[r].id: int(g) for r, g in zip(s.room.tolist(), of_wall.tolist(), strict=True) if r >= 0}
    joined = np.zeros((int(of_wall.max()) + 1,) * 2, dtype=bool)
    for rooms in doors:
        ends = [group[r] for r in rooms if r in group]
        joined[np.ix_(ends, ends)] = True
    np.fill_diagonal(joined, False)
    return joined


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


def _gaps(s: Walls, of_wall: Index) -> Array:
    """(G, G) metres between the nearest walls of two groups, each taken as the box about it."""
    arm = np.abs(s.half[:, None] * s.tangent)
    gap = np.abs(s.centre[:, None] - s.centre[None]) - arm[:, None] - arm[None]
    apart = np.linalg.norm(np.maximum(gap, 0.0), axis=-1)
    order = np.argsort(of_wall, kind="stable")
    first = np.searchsorted(of_wall[order], np.arange(of_wall.max() + 1))
    rows = np.minimum.reduceat(apart[order][:, order], first, axis=0)
    return np.asarray(np.minimum.reduceat(rows, first, axis=1))


def _edges(gaps: Array, joined: NDArray[np.bool_]) -> Index:
    """(E, 2) the doors' pairs, near ones, and what joins all."""
    from scipy.sparse.csgraph import minimum_spanning_tree  # slow to import

    rank = np.argsort(np.argsort(gaps, axis=1, kind="stable"), axis=1, kind="stable")
    near = (gaps < BESIDE) & ((rank <= MOST_NEIGHBOURS) | (rank.T <= MOST_NEIGHBOURS))
    tree = minimum_spanning_tree(gaps + 1e-9).toarray() > 0
    return np.stack(np.nonzero(np.triu(near | tree | tree.T | joined, 1)), axis=-1)


def _hops(edges: Index, steps: Index, count: int) -> Index:
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import shortest_path

    graph = csr_matrix((steps.astype(float), (edges[:, 0], edges[:, 1])), shape=(count, count))
    return np.asarray(shortest_path(graph, directed=False)).astype(np.int64)
