"""A field of motions: each part of the map has its own, held by its neighbours' and drawn by its walls' lines.

K fields are worked on at once. A group's motion is kept as (yaw, x, y) of its centre after the motion, so that a
small turn does not move it. `field_partners` looks up which walls of the plan each wall of the map may be,
`field_step` moves the field.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from data.compiled import compiled
from data.se2_loops import wrapped
from matching import se2
from matching.bands import Band
from matching.doors import Doors
from matching.groups import Groups
from matching.plan_walls import PlanWalls
from matching.scoring import SIGMA_HEADING, SIGMA_SCORE
from matching.se2 import Array
from matching.walls import Index, Walls

STEP = np.array([np.radians(2.0), 0.2, 0.2])  # how the motion changes from a room to the next


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

    @property
    def s_arrays(self) -> tuple[Array, Array, Index, Array]:
        """Headings, half lengths, groups and arms of the S walls."""
        return self.s.heading, self.s.half, self.groups.of_wall, self.arm


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
class Judged:
    """Per field, S wall and pair (K, Ns, P): quality in [0, 1], and S's mid point off A's line and along it."""

    quality: Array
    beside: Array  # share of S's length that lies beside A's, in [0, 1]
    across: Array
    along: Array
    turned: Array


def judge(scene: Scene, table: Index, state: Array, sigma: float) -> Judged:
    """How well S walls lie on the partners of a table (K, Ns, P), -1 for none; `sigma` in metres across."""
    return Judged(*_judged(*scene.s_arrays, scene.plan.lines, table, state, sigma))


@compiled
def _judged(
    heading: Array, half: Array, of_wall: Index, arm: Array, lines: Array, table: Index, state: Array, sigma: float
) -> Array:
    """(5, K, Ns, P) the fields of `Judged`, all zero where there is no pair."""
    fields, walls, width = table.shape
    found = np.zeros((5, fields, walls, width))
    for k in range(fields):
        for i in range(walls):
            yaw, x, y, _, _ = placed(state[k, of_wall[i]], arm[i])
            for p in range(width):
                if table[k, i, p] >= 0:
                    found[:, k, i, p] = judged(lines[table[k, i, p]], half[i], heading[i] + yaw, x, y, sigma)
    return found


@compiled
def placed(state: Array, arm: Array) -> tuple[float, float, float, float, float]:
    """By how much the state (3,) of a group turns a wall, where it lays its mid point, and this from the centre."""
    cos, sin = np.cos(state[0]), np.sin(state[0])
    lever_x, lever_y = cos * arm[0] - sin * arm[1], sin * arm[0] + cos * arm[1]
    return state[0], state[1] + lever_x, state[2] + lever_y, lever_x, lever_y


@compiled
def judged(
    line: Array, half: float, heading: float, x: float, y: float, sigma: float
) -> tuple[float, float, float, float, float]:
    """The fields of `Judged` for a wall of the map that lies at (x, y), and a line of the plan."""
    across = line[2] * x + line[3] * y - line[4]
    along = line[2] * y - line[3] * x - line[5]
    turned = wrapped(heading - line[1])
    span = 1.6 * min(half, 4.0)  # a fifth of a wall may stand out: its ends slide
    most = min(2 * min(half, line[0]) / span, 1.0)
    beside = min(max((half + line[0]) / span - abs(along) / span, 0.0), most)
    if beside == 0.0:
        return 0.0, beside, across, along, turned
    sigma_turned = SIGMA_HEADING * min(max(sigma / SIGMA_SCORE, 1.0), 2.0)
    quality = beside * np.exp((-0.5 / sigma**2) * across**2 - (0.5 / sigma_turned**2) * turned**2)
    return quality, beside, across, along, turned


def chi2(groups: Groups, state: Array) -> Array:
    """(K, E) the squares, in their deviations, of how the motions of neighbours differ at the point between them."""
    return np.asarray(_chi2(groups.edges, groups.centre, groups.slack[:, None] * STEP, state))


@compiled
def _chi2(edges: Index, centre: Array, slack: Array, state: Array) -> Array:
    """As `chi2`; `slack` (E, 3) are the deviations."""
    found = np.empty((len(state), len(edges)))
    for k in range(len(state)):
        for e in range(len(edges)):
            g, h = edges[e, 0], edges[e, 1]
            (turn, x, y), _, _ = strained(state[k, g], state[k, h], centre[g], centre[h])
            found[k, e] = (turn / slack[e, 0]) ** 2 + (x / slack[e, 1]) ** 2 + (y / slack[e, 2]) ** 2
    return found


@compiled
def strained(
    one: Array, other: Array, centre: Array, other_centre: Array
) -> tuple[tuple[float, float, float], tuple[float, float], tuple[float, float]]:
    """How the states (3,) of neighbours differ at the point between them: radians, metres, metres. And from either
    end's centre to that point."""
    half_x, half_y = (other_centre[0] - centre[0]) / 2, (other_centre[1] - centre[1]) / 2
    cos, sin = np.cos(one[0]), np.sin(one[0])
    x, y = cos * half_x - sin * half_y, sin * half_x + cos * half_y
    cos, sin = -np.cos(other[0]), -np.sin(other[0])
    u, v = cos * half_x - sin * half_y, sin * half_x + cos * half_y
    turn = wrapped(other[0] - one[0])
    return (turn, other[1] - one[1] + u - x, other[2] - one[2] + v - y), (x, y), (u, v)


@compiled
def summed(rows: Index, columns: Index, values: Array, height: int, width: int) -> Array:
    """(height, width) the sums of values (N, P) by the row of each of N and its columns (N, P); -1 is the last."""
    total = np.zeros((height, width))
    for i in range(len(rows)):
        for p in range(columns.shape[1]):
            total[rows[i], columns[i, p]] += values[i, p]
    return total
