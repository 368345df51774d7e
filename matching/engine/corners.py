"""Corners of a storey: two walls of a room that meet, or of which one has no room.

A corner has the crossing of its walls, the direction between their normals, the angle between them, and which way they
extend from the crossing, which separates a room's corner from a pillar's.
"""

from dataclasses import dataclass

import numpy as np

from data.common.compiled import compiled
from data.geometry import se2
from data.geometry.se2 import Array
from matching.arrays import Index, Walls

REACH = 1.0  # metres from a wall's end to the crossing
LEAST_SINE = float(np.sin(np.radians(30)))


@dataclass(frozen=True)
class Marks:
    """Voting features: (M, 2) points, (M,) headings, openings and kinds. Marks of different kinds never match."""

    point: Array
    heading: Array
    opening: Array
    kind: Index

    def __len__(self) -> int:
        return len(self.point)

    def __getitem__(self, chosen: slice) -> "Marks":
        return Marks(self.point[chosen], self.heading[chosen], self.opening[chosen], self.kind[chosen])


def corners(walls: Walls, chosen: Index | None = None) -> Marks:
    """Returns the corners of walls (all, unless some are chosen), each with one heading."""
    chosen = np.arange(len(walls)) if chosen is None else chosen
    room = walls.room[chosen]
    order = np.argsort(room, kind="stable")
    roomless = int(np.count_nonzero(room < 0))
    begins = np.searchsorted(room[order], np.unique(room[order[roomless:]]))
    ends = np.append(begins[1:], len(order))
    pairs = _near(walls.centre, walls.half, chosen, order, begins, ends, roomless)
    return Marks(*_met(walls.centre, walls.normal, walls.heading, walls.half, pairs))


@compiled
def _near(centre: Array, half: Array, chosen: Index, order: Index, begins: Index, ends: Index, roomless: int) -> Index:
    """(E, 2) pairs of walls that may meet; the first `roomless` walls in the order have no room."""
    found = [(0, 0) for _ in range(0)]
    for n in range(len(begins)):
        for i in range(begins[n], ends[n]):
            for k in range(i + 1, ends[n]):
                found.append((chosen[order[i]], chosen[order[k]]))
    lone = np.zeros(len(order), dtype=np.bool_)
    lone[order[:roomless]] = True
    for n in order[:roomless]:
        for m in range(len(order)):
            if m != n and (m > n or not lone[m]):
                i, k = chosen[n], chosen[m]
                x, y = centre[k, 0] - centre[i, 0], centre[k, 1] - centre[i, 1]
                if np.hypot(x, y) < half[i] + half[k] + 2 * REACH:
                    found.append((i, k))
    pairs = np.empty((len(found), 2), dtype=np.int64)
    for n in range(len(found)):
        pairs[n, 0], pairs[n, 1] = found[n]
    return pairs


def _met(centre: Array, normal: Array, heading: Array, half: Array, pairs: Index) -> tuple[Array, Array, Array, Index]:
    """Points, headings, openings and kinds of the corners of the pairs that meet."""
    turn = se2.wrap(heading[pairs[:, 1]] - heading[pairs[:, 0]])
    i, k = np.where(turn > 0, pairs.T, pairs.T[::-1])
    turn = np.abs(turn)
    crossing = np.sin(turn) > LEAST_SINE
    i, k, turn = i[crossing], k[crossing], turn[crossing]
    between, sine = centre[k] - centre[i], np.sin(turn)
    along, back = ((between * normal[n]).sum(axis=1) / sine for n in (k, i))
    met = (np.abs(np.abs(along) - half[i]) < REACH) & (np.abs(np.abs(back) - half[k]) < REACH)
    i, turn, along, back = i[met], turn[met], along[met], back[met]
    point = centre[i] + along[:, None] * np.column_stack((-normal[i, 1], normal[i, 0]))
    return point, heading[i] + turn / 2, turn, 2 * (along > 0) + (back > 0)
