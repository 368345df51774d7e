"""Moves fields of motions step by step, updating the candidate A walls of each wall as they move."""

from dataclasses import dataclass

import numpy as np

from data.common.compiled import compiled
from data.geometry.se2 import Array
from matching.arrays import Index
from matching.engine.field import Fields, Scene
from matching.engine.field_loops import Loops
from matching.engine.field_partners import nearest, partners
from matching.engine.field_step import stepped

FRESH_M, FRESH_RAD = 0.6, float(np.radians(6))  # how far a group may move before its walls' partners are searched again


@dataclass(frozen=True)
class GuidedFields:
    """Fields, and the partners of their walls as found at an earlier state (K, G, 3)."""

    fields: Fields
    seen: Array
    table: Index  # (K, Ns, P) as `partners` gives them

    def __len__(self) -> int:
        return len(self.fields)

    def __getitem__(self, chosen: Index) -> "GuidedFields":
        return GuidedFields(self.fields[chosen], self.seen[chosen], self.table[chosen])


def guided(scene: Scene, fields: Fields) -> GuidedFields:
    """Returns fields with the partners of their walls."""
    return GuidedFields(fields, fields.state, partners(scene, fields))


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
                nearest(m, storey[k], state[k], table[k])
                seen[k] = state[k]
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
