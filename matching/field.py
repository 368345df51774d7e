"""A field of motions: each part of the map has its own, held by its neighbours' and drawn by its walls' lines.

K fields are worked on at once. A group's motion is kept as (yaw, x, y) of its centre after the motion, so that a
small turn does not move it. `field_partners` looks up which walls of the plan each wall of the map may be,
`field_step` moves the field.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from matching import se2
from matching.bands import Band
from matching.doors import Doors
from matching.groups import Groups
from matching.plan_walls import PlanWalls
from matching.scoring import SIGMA_HEADING, SIGMA_SCORE
from matching.se2 import Array
from matching.walls import Index, Walls

STEP = np.array([np.radians(2.0), 0.2, 0.2])  # how the motion changes from a room to the next
BLOCK = 96  # S walls whose partners are sought at once


@dataclass(frozen=True)
class Scene:
    """What is to be laid where."""

    s: Walls
    groups: Groups
    plan: PlanWalls
    doors: Doors  # of the map

    @cached_property
    def group_of_room(self) -> Index:
        """(R,) the group of each of the map's rooms."""
        found = np.full(len(self.s.rooms), -1)
        housed = self.s.room >= 0
        found[self.s.room[housed]] = self.groups.of_wall[housed]
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
    def band(self) -> Band:
        """How the motions of neighbours hang together."""
        return Band.of(self.groups.edges, len(self.groups))

    @cached_property
    def blocks(self) -> list[Index]:
        """The S walls in parts that lie together, none too large."""
        todo, done = [np.arange(len(self.s))], []
        while todo:
            rows = todo.pop()
            if len(rows) <= BLOCK:
                done.append(rows)
                continue
            at = self.s.centre[rows]
            order = rows[np.argsort(at[:, np.ptp(at, axis=0).argmax()], kind="stable")]
            todo += [order[: len(rows) // 2], order[len(rows) // 2 :]]
        return done


@dataclass(frozen=True)
class Fields:
    """K fields: the storey (K,) and the state (K, G, 3) of the groups."""

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
class Placed:
    """The S walls under K fields, all (K, Ns): turned by `yaw`, mid points at `x`, `y`, and those from their
    groups' centres."""

    yaw: Array
    x: Array
    y: Array
    lever_x: Array
    lever_y: Array


def placed(scene: Scene, state: Array) -> Placed:
    """Where a state (K, G, 3) lays the S walls."""
    group, arm = scene.groups.of_wall, scene.arm
    cos, sin = np.cos(state[..., 0])[:, group], np.sin(state[..., 0])[:, group]
    own = state[:, group]
    lever_x, lever_y = cos * arm[:, 0] - sin * arm[:, 1], sin * arm[:, 0] + cos * arm[:, 1]
    return Placed(own[..., 0], own[..., 1] + lever_x, own[..., 2] + lever_y, lever_x, lever_y)


@dataclass(frozen=True)
class Pairs:
    """What is known of the pairs of a table (K, Ns, P) before S is laid anywhere, all of that shape."""

    table: Index  # A walls, -1 where there are fewer
    heading: Array  # of A
    normal_x: Array
    normal_y: Array
    across: Array  # A's centre along its normal,
    along: Array  # and along its tangent
    reach: Array  # how far S's mid point may be along A until they lie beside each other no more,
    most: Array  # and the share that then may lie so, 0 where there is no pair
    span: Array  # (Ns, 1) metres, of which these two are shares

    def __getitem__(self, chosen: Index) -> "Pairs":
        return Pairs(
            self.table[chosen], self.heading[chosen], self.normal_x[chosen], self.normal_y[chosen],
            self.across[chosen], self.along[chosen], self.reach[chosen], self.most[chosen], self.span,
        )  # fmt: skip

    @staticmethod
    def of(scene: Scene, table: Index) -> "Pairs":
        """The pairs of a table of partners."""
        half, heading, n_x, n_y, across, along = np.take(scene.plan.lines, table, axis=1)
        own = scene.s.half[:, None]
        # A fifth of a wall may stand out: its ends slide.
        span = 1.6 * np.minimum(own, 4.0)
        most = np.minimum(2 * np.minimum(own, half) / span, 1.0) * (table >= 0)
        return Pairs(table, heading, n_x, n_y, across, along, (own + half) / span, most, span)


@dataclass(frozen=True)
class Judged:
    """Per field, S wall and pair (K, Ns, P): quality in [0, 1], and S's mid point off A's line and along it."""

    quality: Array
    beside: Array  # share of S's length that lies beside A's, in [0, 1]
    across: Array
    along: Array
    turned: Array


def judge(scene: Scene, table: Index | Pairs, state: Array, sigma: Array | float) -> Judged:
    """How well S walls lie on their partners; `sigma` in metres across, (K, Ns, 1) or one for all."""
    pairs = table if isinstance(table, Pairs) else Pairs.of(scene, table)
    return judged(scene, pairs, placed(scene, state), sigma)


def judged(scene: Scene, pairs: Pairs, at: Placed, sigma: Array | float) -> Judged:
    """As `judge`, of what is known already."""
    x, y = at.x[..., None], at.y[..., None]
    across = pairs.normal_x * x + pairs.normal_y * y - pairs.across
    along = pairs.normal_x * y - pairs.normal_y * x - pairs.along
    turned = se2.wrap((scene.s.heading + at.yaw)[..., None] - pairs.heading)
    beside = np.clip(pairs.reach - np.abs(along) / pairs.span, 0.0, pairs.most)
    sigma_turned = SIGMA_HEADING * np.clip(np.asarray(sigma) / SIGMA_SCORE, 1.0, 2.0)
    quality = beside * np.exp((-0.5 / np.square(sigma)) * across**2 - (0.5 / sigma_turned**2) * turned**2)
    return Judged(quality, beside, across, along, turned)


def strain(groups: Groups, state: Array) -> Array:
    """(3, K, E) how the motions of neighbours differ at the point between them: radians, metres, metres."""
    return strain_and_arms(groups, state)[0]


def strain_and_arms(groups: Groups, state: Array) -> tuple[Array, tuple[Array, Array]]:
    """The strain, and from either end's centre (2, K, E) to the point between."""
    g, h = groups.edges.T
    one, other = state[:, g], state[:, h]
    half_x, half_y = ((groups.centre[h] - groups.centre[g]) / 2).T
    arms = []
    for yaw, sign in ((one[..., 0], 1.0), (other[..., 0], -1.0)):
        cos, sin = sign * np.cos(yaw), sign * np.sin(yaw)
        arms.append(np.stack((cos * half_x - sin * half_y, sin * half_x + cos * half_y)))
    apart = np.moveaxis(other - one, -1, 0)
    return np.concatenate((se2.wrap(apart[:1]), apart[1:] + arms[1] - arms[0])), (arms[0], arms[1])


def chi2(groups: Groups, state: Array) -> Array:
    """(K, E) the strain's squares, in its deviations."""
    sigma = (STEP * groups.slack[:, None]).T[:, None]
    return np.asarray(((strain(groups, state) / sigma) ** 2).sum(axis=0))
