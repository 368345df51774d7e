"""A field of motions: each part of the map has its own, tied to its neighbours' and aligned with the plan's walls.

K fields are processed at once. A group's motion is kept as (yaw, x, y) of its centre after the motion, so that a small
rotation does not move it. `field_loops` moves a field by a step, `guided_field` finds the walls of the plan that each
wall of the map may be.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from data.common.compiled import compiled
from data.geometry import se2
from data.geometry.se2 import Array
from matching.arrays import Doors, Index, Walls
from matching.arrays.blocks import elimination
from matching.arrays.groups import Groups
from matching.engine.field_loops import Loops, compared, sharpness, strained, turns, wall_poses, wrapped
from matching.engine.plan_walls import PlanWalls

STEP = np.array([np.radians(2.0), 0.2, 0.2])  # how the motion changes from a room to the next
DISTINCT_M, DISTINCT_RAD = 0.5, float(np.radians(5))
LEAST_WEIGHT = 1e-6  # of a wall that is not explained


@dataclass(frozen=True)
class Scene:
    """A map, its groups and doors, and the plan in which it is searched."""

    s: Walls
    groups: Groups
    plan: PlanWalls
    doors: Doors  # of the map

    @cached_property
    def group_of_room(self) -> Index:
        """(R,) the group of each of the map's rooms."""
        found = np.full(len(self.s.rooms), -1)
        with_room = self.s.room >= 0
        found[self.s.room[with_room]] = self.groups.of_wall[with_room]
        return found

    @cached_property
    def arm(self) -> Array:
        """(Ns, 2) from the centre of each S wall's group to the wall's."""
        return np.asarray(self.s.centre - self.groups.centre[self.groups.of_wall])

    @cached_property
    def member(self) -> Array:
        """(Ns, G) 1 for the group of each S wall."""
        return np.asarray(self.groups.of_wall[:, None] == np.arange(len(self.groups)), dtype=float)

    @cached_property
    def incidence(self) -> Array:
        """(2 E, G) 1 for the first ends of the edges, then the second ones."""
        return np.asarray(self.groups.edges.T.reshape(-1, 1) == np.arange(len(self.groups)), dtype=float)

    @cached_property
    def loops(self) -> Loops:
        """The scene as arrays for compiled loops."""
        s, groups, plan = self.s, self.groups, self.plan
        return Loops(
            s.heading, s.half, s.weight, groups.of_wall, self.arm, groups.centre, groups.edges,
            groups.slack[:, None] * STEP, elimination(groups.edges, len(groups)), plan.lines, *plan.by_heading,
            plan.first,
        )  # fmt: skip


@dataclass(frozen=True)
class Fields:
    """K fields: the storey (K,) and the state (K, G, 3) of the groups, (yaw, x, y) of each centre after the motion."""

    storey: Index
    state: Array

    def __len__(self) -> int:
        return len(self.storey)

    def __getitem__(self, chosen: Index) -> "Fields":
        return Fields(self.storey[chosen], self.state[chosen])


def rigid_state(scene: Scene, motions: Array) -> Array:
    """(K, G, 3) state of the groups under rigid motions (K, 3)."""
    at = se2.apply(motions[:, None, :], scene.groups.centre[None])
    return np.concatenate((np.broadcast_to(motions[:, None, :1], (*at.shape[:2], 1)), at), axis=-1)


def motions(scene: Scene, state: Array) -> Array:
    """(K, G, 3) motions of the groups, between own frames."""
    return np.concatenate((state[..., :1], state[..., 1:] - se2.rotate(state[..., 0], scene.groups.centre)), axis=-1)


@dataclass(frozen=True)
class Judged:
    """For each field, S wall and pair (K, Ns, P): quality in [0, 1], and S's mid point across and along A's line."""

    quality: Array
    beside: Array  # share of S's length that lies beside A's, in [0, 1]
    across: Array
    along: Array
    turned: Array


def judge(scene: Scene, table: Index, state: Array, sigma: float) -> Judged:
    """Scores how well S walls lie on their partners in a table (K, Ns, P), -1 for none; `sigma` in metres across."""
    return Judged(*_judged(scene.loops, table, state, sigma))


@compiled
def _judged(m: Loops, table: Index, state: Array, sigma: float) -> Array:
    """(5, K, Ns, P) the fields of `Judged`, all zero where there is no pair."""
    lines, half = m.lines, m.half
    fields, walls, width = table.shape
    found, sharp = np.zeros((5, fields, walls, width)), sharpness(sigma)
    for k in range(fields):
        pose = wall_poses(m, state[k], turns(state[k]))
        for i in range(walls):
            for p in range(width):
                if table[k, i, p] >= 0:
                    across, along, turned, beside = compared(lines, table[k, i, p], half[i], pose, i)
                    strange = sharp[0] * across**2 + sharp[1] * turned**2
                    quality = beside * np.exp(-strange) if beside > 0 else 0.0
                    found[0, k, i, p], found[1, k, i, p], found[2, k, i, p] = quality, beside, across
                    found[3, k, i, p], found[4, k, i, p] = along, turned
    return found


def explained(scene: Scene, table: Index, state: Array, sigma: float) -> Array:
    """(K, Ns) the quality of each S wall's best pair, see `judge`."""
    return np.asarray(judge(scene, table, state, sigma).quality.max(axis=2, initial=0.0))


def chi2(scene: Scene, state: Array) -> Array:
    """(K, E) the squared, normalised differences of the motions of neighbours at the point between them."""
    return np.asarray(_chi2(scene.loops, state))


@compiled
def _chi2(m: Loops, state: Array) -> Array:
    found = np.empty((len(state), len(m.edges)))
    for k in range(len(state)):
        turn = turns(state[k])
        for e in range(len(m.edges)):
            found[k, e], _, _, _ = strained(m, e, state[k], turn)
    return found


def rigid(scene: Scene, fields: Fields, quality: Array) -> Array:
    """(K, 3) the rigid motions nearest to fields, from the ends of the walls they explain with quality (K, Ns)."""
    s, state = scene.s, fields.state[:, scene.groups.of_wall]
    weight = s.weight * quality + LEAST_WEIGHT
    weight /= weight.sum(axis=1, keepdims=True)
    placed, half = state[..., 1:] + se2.rotate(state[..., 0], scene.arm), s.half[:, None] * s.tangent
    p, q = np.einsum("kn,nd->kd", weight, s.centre), np.einsum("kn,knd->kd", weight, placed)
    before = np.concatenate((s.centre - p[:, None], np.broadcast_to(half, placed.shape)), axis=1)
    after = np.concatenate((placed - q[:, None], se2.rotate(state[..., 0], half)), axis=1)
    weight = np.concatenate((weight, weight), axis=1)  # the middles, and the ends about them
    cross = before[..., 0] * after[..., 1] - before[..., 1] * after[..., 0]
    yaw = np.arctan2((weight * cross).sum(axis=1), np.einsum("kn,knd,knd->k", weight, before, after))
    return np.column_stack((yaw, q - se2.rotate(yaw, p)))


@compiled
def distinct(storey: Index, rigid: Array) -> Index:
    """Indices of those that differ from all earlier ones: in storey, at S's centroid (the origin) or in yaw."""
    kept, count = np.empty(len(rigid), dtype=np.int64), 0
    for n in range(len(rigid)):
        new = True
        for m in kept[:count]:
            off = np.hypot(rigid[m, 1] - rigid[n, 1], rigid[m, 2] - rigid[n, 2])
            near = off <= DISTINCT_M and abs(wrapped(rigid[m, 0] - rigid[n, 0])) <= DISTINCT_RAD
            new = new and not (near and storey[m] == storey[n])
        if new:
            kept[count] = n
            count += 1
    return kept[:count].copy()
