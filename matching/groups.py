"""The parts of a map that are taken as rigid, the rooms, and which of them lie side by side."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from data.compiled import compiled
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


def _gaps(s: Walls, of_wall: Index, count: int) -> Array:
    """(G, G) metres between the walls of two groups, roughly, infinite where none are near each other."""
    points = np.maximum(np.ceil(2 * s.half / POINTS).astype(np.int64), 1)
    square = _least_squares_apart(s.centre, s.tangent, s.half, points, of_wall, count)
    return np.asarray(np.sqrt(square))


@compiled
def _least_squares_apart(
    centre: Array, tangent: Array, half: Array, points: Index, of_wall: Index, count: int
) -> Array:
    """(G, G) the squares of what `_gaps` tells; walls are looked at as rows of points."""
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
                begin = int(((run - reach) / half[k] + 1) / 2 * points[k]) if half[k] > 0 else 0
                end = int(((run + reach) / half[k] + 1) / 2 * points[k]) + 1 if half[k] > 0 else points[k]
                for m in range(max(begin - 1, 0), min(end + 1, points[k])):
                    at = (2 * ((m + 0.5) / points[k]) - 1) * half[k]
                    square = (u - at * tangent[k, 0]) ** 2 + (v - at * tangent[k, 1]) ** 2
                    if square <= reach * reach and square < least[g, h]:
                        least[g, h] = least[h, g] = square
    return least


def _edges(s: Walls, of_wall: Index, centre: Array, doors: set[tuple[int, int]]) -> Index:
    """(E, 2) the doors' pairs, near ones, and what joins all."""
    from scipy.sparse.csgraph import minimum_spanning_tree

    gap = _gaps(s, of_wall, len(centre))
    apart = 10 + np.linalg.norm(centre[:, None] - centre[None], axis=-1)
    apart = np.where(np.isfinite(gap), gap, apart)
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
