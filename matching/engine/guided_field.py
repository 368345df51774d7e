"""Moves fields of motions step by step, updating the candidate A walls of each wall as they move.

Rooms that explain few walls are restarted at positions nearby: a step of drift can exceed the basin of convergence.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled, compiled_within
from data.geometry.se2 import Array
from matching.arrays import Index
from matching.engine.field import Fields, Scene, chi2, explained
from matching.engine.field_loops import (
    SIGMA_SCORE,
    Loops,
    of_direction,
    off_lines,
    step,
    stepped,
    turns,
    wall_poses,
    wrapped,
)

FRESH_M, FRESH_RAD = 0.6, float(np.radians(6))  # how far a group may move before its walls' partners are searched again
GATE_M = 2.0  # metres across and beyond the ends, of pairs that are considered at all
GATE_RAD = float(np.radians(25))
PARTNERS = 10
ASIDE = 0.45  # metres, along both axes of the plan, both ways
RESTART_SIGMAS = (0.25, 0.18, 0.13)
WELL_EXPLAINED = 0.75  # of a group's walls' weight that are explained
WALL = 2.0  # nats of a wall that is explained, for its weight,
MOST_STRAINED = 12.0  # against half the chi^2 to the neighbours, in the mean


@dataclass(frozen=True)
class GuidedFields:
    """Fields, and the partners of their walls as found at an earlier state (K, G, 3)."""

    fields: Fields
    seen: Array
    table: Index  # (K, Ns, P) walls of the plan, nearest first

    def __len__(self) -> int:
        return len(self.fields)

    def __getitem__(self, chosen: Index) -> "GuidedFields":
        return GuidedFields(self.fields[chosen], self.seen[chosen], self.table[chosen])


def guided(scene: Scene, fields: Fields) -> GuidedFields:
    """Returns fields with the partners of their walls: the nearest PARTNERS, -1 where there are fewer."""
    table = np.empty((len(fields), len(scene.s), PARTNERS), dtype=np.int64)
    unseen = np.full_like(fields.state, np.inf)
    return advance(scene, GuidedFields(fields, unseen, table), np.empty((0, *fields.state.shape[:2])))


def advance(scene: Scene, begin: GuidedFields, sigmas: Array, search_every: int = 1) -> GuidedFields:
    """Returns the fields after T steps with `sigmas` (T, K, G), see `step`.

    Partners are searched again before every `search_every` steps, and after the last, for fields that have moved far.
    """
    storey, state, seen, table = begin.fields.storey, begin.fields.state.copy(), begin.seen.copy(), begin.table.copy()
    _advance(scene.loops, storey, sigmas, search_every, state, seen, table)
    return GuidedFields(Fields(storey, state), seen, table)


@compiled
def _advance(
    m: Loops, storey: Index, sigmas: Array, search_every: int, state: Array, seen: Array, table: Index
) -> None:
    for k in range(len(state)):
        for t in range(len(sigmas) + 1):
            if (t % search_every == 0 or t == len(sigmas)) and _out_of_date(state[k], seen[k]):
                _nearest(m, storey[k], state[k], table[k])
                for g in range(len(m.centre)):
                    for d in range(3):  # a copy of arrays takes seconds to compile
                        seen[k, g, d] = state[k, g, d]
            if t < len(sigmas):
                stepped(m, table[k], state[k], sigmas[t, k])


@compiled
def _out_of_date(state: Array, seen: Array) -> bool:
    """Whether one field (G, 3) has moved far since its partners were found."""
    for g in range(len(state)):
        moved = max(abs(state[g, 1] - seen[g, 1]), abs(state[g, 2] - seen[g, 2]))
        if moved > FRESH_M or abs(state[g, 0] - seen[g, 0]) > FRESH_RAD:
            return True
    return False


@compiled_within
def _nearest(m: Loops, storey: int, state: Array, table: Index) -> None:
    """Writes the partners (Ns, PARTNERS) of one field; only A walls of a similar direction are considered."""
    least_cos, cost, pose = np.cos(GATE_RAD), np.empty(PARTNERS), wall_poses(m, state, turns(state))
    half, lines, order = m.half, m.ordered_lines, m.order
    begin, end = m.first[storey], m.first[storey + 1]
    across = np.empty(end - begin)
    table[:] = -1
    for i in range(len(pose)):
        x, y, turned, count = pose[i, 1], pose[i, 2], wrapped(pose[i, 0]), 0
        cos, sin = np.cos(turned), np.sin(turned)
        stretch = of_direction(m.ordered, begin, end, turned, GATE_RAD + 1e-9)
        for first, last in (stretch[:2], stretch[2:]):
            off_lines(lines, first, last, x, y, across)
            for n in range(first, last):
                off = across[n - first]
                if off > GATE_M or cos * lines[2, n] + sin * lines[3, n] < least_cos:
                    continue
                off += max(abs(lines[2, n] * y - lines[3, n] * x - lines[5, n]) - lines[0, n] - half[i], 0.0)
                if off <= GATE_M:
                    count = _inserted(table, i, cost, count, order[n], off)


@compiled
def _inserted(table: Index, i: int, cost: Array, count: int, j: int, off: float) -> int:
    """Inserts a wall among the `count` nearest ones of a row (the first of ties stays first) and returns their new
    number.
    """
    most, at = table.shape[1], min(count, table.shape[1])
    while at > 0 and (off < cost[at - 1] or (off == cost[at - 1] and j < table[i, at - 1])):
        at -= 1
    if at == most:
        return count
    count = min(count + 1, most)
    for later in range(count - 1, at, -1):
        table[i, later], cost[later] = table[i, later - 1], cost[later - 1]
    table[i, at], cost[at] = j, off
    return count


def restart_locally(scene: Scene, fields: Fields, known: Index) -> Fields:
    """Returns the fields with each poorly explained group moved to where it explains most, given its neighbours."""
    poor = _explained(scene, known, fields.state) < WELL_EXPLAINED * (scene.s.weight @ scene.member)
    some = np.flatnonzero(poor.any(axis=1))
    if not len(some):
        return fields
    state = fields.state.copy()
    state[some] = _tried(scene, state[some], known[some], poor[some])
    return Fields(fields.storey, state)


def _tried(scene: Scene, state: Array, table: Index, poor: NDArray[np.bool_]) -> Array:
    """(K, G, 3) the best position nearby for each poorly explained group."""
    K, G = state.shape[:2]
    shifts = ASIDE * np.array([(0.0, 0.0), (1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)])
    tried = np.repeat(state[:, None], len(shifts), axis=1)  # (K, shifts, G, 3)
    tried[..., 1:] += shifts[None, :, None] * poor[:, None, :, None]
    tried = tried.reshape(-1, G, 3)
    table = np.repeat(table, len(shifts), axis=0)
    for sigma in RESTART_SIGMAS:
        tried = step(scene.loops, table, tried, np.full((len(tried), G), sigma))
    merit = WALL * _explained(scene, table, tried) - 0.5 * strain(scene, tried)
    best = np.where(poor, merit.reshape(K, len(shifts), G).argmax(axis=1), 0)
    return np.asarray(tried.reshape(K, len(shifts), G, 3)[np.arange(K)[:, None], best, np.arange(G)])


def _explained(scene: Scene, table: Index, state: Array) -> Array:
    """(K, G) weight of each group's walls that are explained."""
    return np.asarray((explained(scene, table, state, SIGMA_SCORE) * scene.s.weight) @ scene.member)


def strain(scene: Scene, state: Array) -> Array:
    """(K, G) mean chi^2 of each group to its neighbours."""
    each = np.minimum(chi2(scene, state), MOST_STRAINED)
    total = np.concatenate((each, each), axis=1) @ scene.incidence
    return np.asarray(total / np.maximum(scene.incidence.sum(axis=0), 1.0))
