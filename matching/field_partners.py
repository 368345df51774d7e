"""Which walls of the plan each wall of the map may be, under a field of motions."""

from dataclasses import dataclass

import numpy as np

from data.compiled import compiled
from data.se2_loops import wrapped
from matching.field import Fields, Scene, placed
from matching.se2 import Array
from matching.walls import Index

GATE_M = 2.0  # metres across and beyond the ends, of pairs that are considered at all
GATE_RAD = float(np.radians(25))
PARTNERS = 10
FRESH_M, FRESH_RAD = 0.6, np.radians(6)  # that a group may move before its walls' partners are sought anew


@dataclass(frozen=True)
class Lookup:
    """The partners of fields, as they were found at a state (K, G, 3)."""

    state: Array
    table: Index  # (K, Ns, P) as `partners` gives them

    @staticmethod
    def of(scene: Scene, fields: Fields) -> "Lookup":
        """What is near now."""
        return Lookup(fields.state, partners(scene, fields))

    def __getitem__(self, chosen: Index) -> "Lookup":
        return Lookup(self.state[chosen], self.table[chosen])

    def renewed(self, scene: Scene, fields: Fields) -> "Lookup":
        """The same, of fields that have moved far what is near them now."""
        off = np.abs(fields.state - self.state)
        stale = ((off[..., 1:].max(axis=2) > FRESH_M) | (off[..., 0] > FRESH_RAD)).any(axis=1)
        if not stale.any():
            return self
        fresh = partners(scene, fields[np.flatnonzero(stale)])
        table = np.full((len(fields), fresh.shape[1], max(fresh.shape[2], self.table.shape[2])), -1)
        table[~stale, :, : self.table.shape[2]] = self.table[~stale]
        table[stale, :, : fresh.shape[2]] = fresh
        return Lookup(np.where(stale[:, None, None], fields.state, self.state), table)


def partners(scene: Scene, fields: Fields) -> Index:
    """(K, Ns, P) the A walls that each S wall may be, nearest first, -1 where there are fewer."""
    plan = scene.plan
    table = _nearest(*scene.s_arrays, plan.lines, *plan.by_heading, plan.first, fields.storey, fields.state)
    widest = max(int(np.count_nonzero(table >= 0, axis=2).max()), 1)
    return np.ascontiguousarray(table[:, :, :widest])


@compiled
def _nearest(
    heading: Array, half: Array, of_wall: Index, arm: Array, lines: Array, order: Index, ordered: Array, first: Index,
    storey: Index, state: Array,
) -> Index:  # fmt: skip
    """(K, Ns, PARTNERS); of the A walls in the order of their headings only those of a direction are looked at."""
    fields, walls, least_cos = len(storey), len(half), np.cos(GATE_RAD)
    table, cost = np.full((fields, walls, PARTNERS), -1), np.empty(PARTNERS)
    for k in range(fields):
        begin, end = first[storey[k]], first[storey[k] + 1]
        for i in range(walls):
            yaw, x, y, _, _ = placed(state[k, of_wall[i]], arm[i])
            turned = wrapped(heading[i] + yaw)
            cos, sin = np.cos(turned), np.sin(turned)
            count = 0
            for round_ in (-1, 0, 1):
                low = turned + 2 * np.pi * round_ - GATE_RAD - 1e-9
                at = begin + np.searchsorted(ordered[begin:end], low)
                while at < end and ordered[at] <= low + 2 * GATE_RAD + 2e-9:
                    j = order[at]
                    at += 1
                    off = abs(lines[j, 2] * x + lines[j, 3] * y - lines[j, 4])
                    if off > GATE_M or cos * lines[j, 2] + sin * lines[j, 3] < least_cos:
                        continue
                    off += max(abs(lines[j, 2] * y - lines[j, 3] * x - lines[j, 5]) - lines[j, 0] - half[i], 0.0)
                    if off <= GATE_M:
                        count = _inserted(table[k, i], cost, count, j, off)
    return table


@compiled
def _inserted(row: Index, cost: Array, count: int, j: int, off: float) -> int:
    """Puts a wall among the `count` nearest known ones, of equally near ones the first; how many there are then."""
    at = min(count, len(row))
    while at > 0 and (off < cost[at - 1] or (off == cost[at - 1] and j < row[at - 1])):
        at -= 1
    if at == len(row):
        return count
    count = min(count + 1, len(row))
    for later in range(count - 1, at, -1):
        row[later], cost[later] = row[later - 1], cost[later - 1]
    row[at], cost[at] = j, off
    return count
