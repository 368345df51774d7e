"""Which walls of the plan each wall of the map may be, under a field of motions."""

import numpy as np

from data.compiled import compiled
from data.se2_loops import wrapped
from matching.field import Fields, Scene
from matching.field_loops import Loops, laid
from matching.se2 import Array
from matching.walls import Index

GATE_M = 2.0  # metres across and beyond the ends, of pairs that are considered at all
GATE_RAD = float(np.radians(25))
PARTNERS = 10


def partners(scene: Scene, fields: Fields) -> Index:
    """(K, Ns, PARTNERS) the A walls that each S wall may be, nearest first, -1 where there are fewer."""
    return np.asarray(_partners(scene.loops, fields.storey, fields.state))


@compiled
def _partners(m: Loops, storey: Index, state: Array) -> Index:
    table = np.empty((len(storey), len(m.heading), PARTNERS), dtype=np.int64)
    for k in range(len(storey)):
        nearest(m, storey[k], state[k], table[k])
    return table


@compiled
def nearest(m: Loops, storey: int, state: Array, table: Index) -> None:
    """Writes the partners (Ns, PARTNERS) of one field; of the A walls only those of a direction are looked at."""
    least_cos, cost, pose = np.cos(GATE_RAD), np.empty(PARTNERS), laid(m, state)
    begin, end = m.first[storey], m.first[storey + 1]
    table[:] = -1
    for i in range(len(pose)):
        _, x, y, _, _ = pose[i]
        turned, count = wrapped(pose[i, 0]), 0
        cos, sin = np.cos(turned), np.sin(turned)
        for round_ in (-1, 0, 1):
            low = turned + 2 * np.pi * round_ - GATE_RAD - 1e-9
            at = begin + np.searchsorted(m.ordered[begin:end], low)
            while at < end and m.ordered[at] <= low + 2 * GATE_RAD + 2e-9:
                j = m.order[at]
                at += 1
                off = abs(m.lines[j, 2] * x + m.lines[j, 3] * y - m.lines[j, 4])
                if off > GATE_M or cos * m.lines[j, 2] + sin * m.lines[j, 3] < least_cos:
                    continue
                run = abs(m.lines[j, 2] * y - m.lines[j, 3] * x - m.lines[j, 5])
                off += max(run - m.lines[j, 0] - m.half[i], 0.0)
                if off <= GATE_M:
                    count = _inserted(table[i], cost, count, j, off)


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
