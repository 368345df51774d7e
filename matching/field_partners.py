"""Which walls of the plan each wall of the map may be, under a field of motions."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from matching import se2
from matching.field import Fields, Pairs, Placed, Scene, placed
from matching.se2 import Array
from matching.walls import Index

GATE_M = 2.0  # metres across and beyond the ends, of pairs that are considered at all
GATE_RAD = np.radians(25)
SIDES = 8  # directions of walls that are told apart when partners are sought
SIDE = 2 * np.pi / SIDES
PARTNERS = 10
SMALL = 300  # walls of a storey, of which all of a direction are compared; of larger ones those in a window
FEW = 60_000  # comparisons that may as well be made at once

FRESH_M, FRESH_RAD = 0.6, np.radians(6)  # that a group may move before its walls' partners are sought anew


@dataclass(frozen=True)
class Lookup:
    """The partners of fields, as they were found at a state (K, G, 3)."""

    state: Array
    pairs: Pairs

    @property
    def table(self) -> Index:
        """(K, Ns, P) as `partners` gives them."""
        return self.pairs.table

    @staticmethod
    def of(scene: Scene, fields: Fields) -> "Lookup":
        """What is near now."""
        return Lookup(fields.state, Pairs.of(scene, partners(scene, fields)))

    def __getitem__(self, chosen: Index) -> "Lookup":
        return Lookup(self.state[chosen], self.pairs[chosen])

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
        return Lookup(np.where(stale[:, None, None], fields.state, self.state), Pairs.of(scene, table))


def partners(scene: Scene, fields: Fields) -> Index:
    """(K, Ns, P) the A walls that each S wall may be, nearest first, -1 where there are fewer."""
    K, N = len(fields), len(scene.s)
    at = placed(scene, fields.state)
    found = [_near(scene, at, *window) for window in _windows(scene, fields, at)]
    row, wall, cost = (np.concatenate(x) for x in zip(*found, strict=True))
    order = np.lexsort((cost, row))
    row, wall = row[order], wall[order]
    rank = np.arange(len(row)) - np.searchsorted(row, row)
    kept = rank < PARTNERS
    table = np.full((K * N, int(rank[kept].max(initial=0)) + 1), -1)
    table[row[kept], rank[kept]] = wall[kept]
    return table.reshape(K, N, -1)


def _windows(scene: Scene, fields: Fields, at: Placed) -> Iterator[tuple[int, Index, Index]]:
    """A storey, rows k Ns + i, and some of the storey's walls: what is compared, all with all."""
    N = len(scene.s)
    side = np.floor((scene.s.heading + at.yaw) / SIDE).astype(np.int64).ravel() % SIDES
    for storey in np.unique(fields.storey).tolist():
        a, chosen = scene.plan.storeys[storey], np.flatnonzero(fields.storey == storey)
        if len(a) <= SMALL:
            rows = (chosen[:, None] * N + np.arange(N)).ravel()
            if len(rows) * len(a) <= FEW:
                yield storey, rows, np.arange(len(a))
                continue
            for of in np.unique(side[rows]).tolist():
                turned = np.abs(se2.wrap(a.heading - (of + 0.5) * SIDE))
                yield storey, rows[side[rows] == of], np.flatnonzero(turned < SIDE / 2 + GATE_RAD)
            continue
        arm = a.half[:, None] * np.abs(a.tangent)
        low_a, high_a = a.centre - arm, a.centre + arm
        for k in chosen.tolist():
            for block in scene.blocks:
                reach = float(scene.s.half[block].max() + GATE_M)
                own = np.stack((at.x[k, block], at.y[k, block]), axis=-1)
                low, high = own.min(axis=0) - reach, own.max(axis=0) + reach
                yield storey, k * N + block, np.flatnonzero(((high_a > low) & (low_a < high)).all(axis=1))


def _near(scene: Scene, at: Placed, storey: int, rows: Index, inside: Index) -> tuple[Index, Index, Array]:
    """Pairs that are near: the row, the wall of the plan, and how far off it is in metres."""
    s, wall = scene.s, rows % len(scene.s)
    inside = inside + scene.plan.first[storey]
    half, _, n_x, n_y, off, off_along = scene.plan.lines[:, inside]
    point = np.stack((at.x.ravel()[rows], at.y.ravel()[rows], np.ones(len(rows))), axis=-1)
    cost = np.abs(point @ np.stack((n_x, n_y, -off)))
    beyond = np.abs(point @ np.stack((-n_y, n_x, -off_along)))
    beyond -= half
    beyond -= s.half[wall, None]
    cost += np.maximum(beyond, 0.0, out=beyond)
    heading = s.heading[wall] + at.yaw.ravel()[rows]
    alike = np.stack((np.cos(heading), np.sin(heading)), axis=-1) @ np.stack((n_x, n_y)) >= np.cos(GATE_RAD)
    i, j = np.nonzero((cost <= GATE_M) & alike)
    return rows[i], inside[j], cost[i, j]
