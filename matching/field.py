"""A field of motions: each part of the map has its own, held by its neighbours' and drawn by its walls' lines.

K fields are worked on at once. A group's motion is kept as (yaw, x, y) of its centre after the motion, so that a
small turn does not move it. Each step is one Gauss-Newton step over all groups jointly: the walls' offsets from
lines and their directions, and between neighbours the difference of their motions at the point between them. This
is weighted down where it is large (Geman-McClure): drift runs along the robot's way, and neighbours may have been
met far apart on it.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from matching import se2
from matching.doors import Doors
from matching.groups import Groups
from matching.plan_walls import PlanWalls
from matching.scoring import SIGMA_ALONG, SIGMA_HEADING, SIGMA_SCORE
from matching.se2 import Array
from matching.walls import Index, Walls

STEP = np.array([np.radians(2.0), 0.2, 0.2])  # how the motion changes from a room to the next
ROBUST = 3.0  # of those deviations, from where on neighbours hold one another less
HELD = np.array([np.radians(10), 1.0, 1.0])  # one step of the estimate is at most about so large
GATE_M = 2.0  # metres across and beyond the ends, of pairs that are considered at all
GATE_RAD = np.radians(25)
PARTNERS = 10
BLOCK = 96  # S walls whose partners are sought at once
DENSE = 24  # groups; of more the normal equations are solved as sparse ones
SIGMA_TILT = np.radians(1.2)  # of a wall's direction in the map against the plan's
OFF_LINE = 0.03  # metres, of the ends of a wall: short ones tell less of a direction
SHARPEST = 0.1  # metres across, with which the directions count in full
SILENT = 1e3  # metres across: of walls that do not speak


@dataclass(frozen=True)
class Scene:
    """What is to be laid where."""

    s: Walls
    groups: Groups
    plan: PlanWalls
    doors: Doors  # of the map
    plan_doors: tuple[Doors, ...]  # of each storey

    @cached_property
    def group_of_room(self) -> Index:
        """(R,) the group of each of the map's rooms."""
        found = np.full(len(self.s.rooms), -1)
        housed = self.s.room >= 0
        found[self.s.room[housed]] = self.groups.of_wall[housed]
        return found

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
    centre = np.broadcast_to(scene.groups.centre, state[..., 1:].shape)
    return np.concatenate((state[..., :1], state[..., 1:] - se2.rotate(state[..., 0], centre)), axis=-1)


def partners(scene: Scene, fields: Fields) -> Index:
    """(K, Ns, P) the A walls that each S wall may be, nearest first, -1 where there are fewer."""
    table = np.full((len(fields), len(scene.s), PARTNERS), -1)
    moved = motions(scene, fields.state)[:, scene.groups.of_wall]  # (K, Ns, 3)
    placed = se2.apply(moved, scene.s.centre[None])
    for k, storey in enumerate(fields.storey.tolist()):
        a, first = scene.plan.storeys[storey], int(scene.plan.first[storey])
        arm = a.half[:, None] * np.abs(a.tangent)
        for rows in scene.blocks:
            reach = float(scene.s.half[rows].max() + GATE_M)
            low, high = placed[k, rows].min(axis=0) - reach, placed[k, rows].max(axis=0) + reach
            inside = np.flatnonzero(((a.centre + arm > low) & (a.centre - arm < high)).all(axis=1))
            best = _nearest(scene.s, rows, placed[k, rows], moved[k, rows, 0], a, inside)
            table[k, rows, : best.shape[1]] = np.where(best >= 0, first + best, -1)
    used = int((table >= 0).sum(axis=2).max(initial=1))
    return table[:, :, :used]


def _nearest(s: Walls, rows: Index, placed: Array, yaw: Array, a: Walls, inside: Index) -> Index:
    """(rows, P) the nearest A walls of those `inside`, -1 where none is near."""
    turned = se2.wrap((s.heading[rows] + yaw)[:, None] - a.heading[inside])
    off_x, off_y = placed[:, :1] - a.centre[inside, 0], placed[:, 1:] - a.centre[inside, 1]
    n_x, n_y = a.normal[inside].T
    beyond = np.abs(off_y * n_x - off_x * n_y) - a.half[inside] - s.half[rows, None]
    cost = np.abs(off_x * n_x + off_y * n_y) + np.maximum(beyond, 0.0)
    cost[(np.abs(turned) > GATE_RAD) | (cost > GATE_M)] = np.inf
    if len(inside) > 4 * PARTNERS:
        some = np.argpartition(cost, PARTNERS, axis=1)[:, :PARTNERS]
        some = np.take_along_axis(some, np.argsort(np.take_along_axis(cost, some, axis=1), axis=1), axis=1)
    else:
        some = np.argsort(cost, axis=1)[:, :PARTNERS]
    return np.where(np.isfinite(np.take_along_axis(cost, some, axis=1)), inside[some], -1)


@dataclass(frozen=True)
class Judged:
    """Per field, S wall and pair (K, Ns, P): quality in [0, 1], and S's mid point off A's line and along it."""

    quality: Array
    beside: Array  # share of S's length that lies beside A's, in [0, 1]
    across: Array
    along: Array
    turned: Array
    placed: Array  # (K, Ns, 2) S's mid points in A


def judge(scene: Scene, table: Index, state: Array, sigma: Array | float) -> Judged:
    """How well S walls lie on their partners; `sigma` in metres across, (K, Ns, 1) or one for all."""
    s, plan, group = scene.s, scene.plan, scene.groups.of_wall
    moved = motions(scene, state)[:, group]
    placed = se2.apply(moved, s.centre[None])
    heading = plan.heading[table]
    step = placed[:, :, None] - plan.centre[table]
    c, n = np.cos(heading), np.sin(heading)
    across = c * step[..., 0] + n * step[..., 1]
    along = c * step[..., 1] - n * step[..., 0]
    turned = se2.wrap((s.heading + moved[..., 0])[..., None] - heading)
    hs, ha = s.half[None, :, None], plan.half[table]
    common = np.minimum(hs + ha - np.abs(along), 2 * np.minimum(hs, ha))
    # A fifth of a wall may stand out: its ends slide.
    beside = np.where(table >= 0, np.clip(common / (1.6 * np.minimum(hs, 4.0)), 0.0, 1.0), 0.0)
    sigma_turned = SIGMA_HEADING * np.clip(np.asarray(sigma) / SIGMA_SCORE, 1.0, 2.0)
    quality = beside * np.exp(-0.5 * (across / sigma) ** 2 - 0.5 * (turned / sigma_turned) ** 2)
    return Judged(quality, beside, across, along, turned, placed)


def step(scene: Scene, table: Index, state: Array, sigma: Array) -> Array:
    """One Gauss-Newton step. `sigma` (K, G) metres; infinite for a group whose walls do not speak yet."""
    H, g = _unary(scene, table, state, sigma)
    new = state + _solved(scene.groups, H + np.diag(1 / HELD**2), g, *_pairwise(scene.groups, state))
    new[..., 0] = se2.wrap(new[..., 0])
    return np.asarray(new)


def _unary(scene: Scene, table: Index, state: Array, sigma: Array) -> tuple[Array, Array]:
    """Of the walls: (K, G, 3, 3) information and (K, G, 3) gradient, each wall against its best partner."""
    s, plan, group = scene.s, scene.plan, scene.groups.of_wall
    per_wall = np.minimum(sigma[:, group], SILENT)
    now = judge(scene, table, state, per_wall[..., None])
    best = now.quality.argmax(axis=2)[..., None]
    quality, across, along, turned = (
        np.take_along_axis(x, best, axis=2)[..., 0] for x in (now.quality, now.across, now.along, now.turned)
    )
    weight = np.where(per_wall < SILENT, quality * s.weight, 0.0) / per_wall**2
    j = np.take_along_axis(table, best, axis=2)[..., 0]
    heading = plan.heading[j]
    normal = np.stack((np.cos(heading), np.sin(heading)), axis=-1)
    tangent = np.stack((-normal[..., 1], normal[..., 0]), axis=-1)
    lever = now.placed - state[:, group, 1:]
    excess = np.sign(along) * np.maximum(np.abs(along) - np.abs(plan.half[j] - s.half), 0.0)
    slide = 0.25 * (per_wall / SIGMA_ALONG) ** 2
    heading_sigma = np.hypot(SIGMA_TILT, OFF_LINE / s.half)
    rows = (
        (_turning(normal, lever), *np.moveaxis(normal, -1, 0), across, weight),
        (_turning(tangent, lever), *np.moveaxis(tangent, -1, 0), excess, slide * weight),
        (1.0, 0.0, 0.0, turned, weight * SHARPEST**2 / heading_sigma**2),
    )
    K, G = sigma.shape
    flat = (np.arange(K)[:, None] * G + group).ravel()
    H, g = np.zeros((K, G, 3, 3)), np.zeros((K, G, 3))
    for *J, residual, w in rows:
        for m in range(3):
            g[..., m] -= np.bincount(flat, (w * residual * J[m]).ravel(), K * G).reshape(K, G)
            for n in range(m, 3):
                H[..., m, n] += np.bincount(flat, (w * J[m] * J[n]).ravel(), K * G).reshape(K, G)
    for m, n in ((0, 1), (0, 2), (1, 2)):
        H[..., n, m] = H[..., m, n]
    return H, g


def _turning(direction: Array, lever: Array) -> Array:
    """How a residual along `direction` grows with the turn of a group, `lever` from its centre."""
    return np.asarray(direction[..., 1] * lever[..., 0] - direction[..., 0] * lever[..., 1])


def strain(groups: Groups, state: Array) -> Array:
    """(K, E, 3) how the motions of neighbours differ at the point between them: radians, metres, metres."""
    return _strain(groups, state)[0]


def _strain(groups: Groups, state: Array) -> tuple[Array, Array, Array]:
    g, h = groups.edges.T
    middle = (groups.centre[g] + groups.centre[h]) / 2
    shape = (len(state), *middle.shape)
    arms = [se2.rotate(state[:, e, 0], np.broadcast_to(middle - groups.centre[e], shape)) for e in (g, h)]
    shift = state[:, h, 1:] + arms[1] - state[:, g, 1:] - arms[0]
    turn = se2.wrap(state[:, h, :1] - state[:, g, :1])
    return np.concatenate((turn, shift), axis=-1), arms[0], arms[1]


def _pairwise(groups: Groups, state: Array) -> tuple[Array, Array]:
    """Of the edges: (2, 2, K, E, 3, 3) information of their ends, with each other, and (2, K, E, 3) gradient."""
    residual, *arms = _strain(groups, state)
    sigma = STEP * groups.slack[:, None]
    chi2 = ((residual / sigma) ** 2).sum(axis=-1, keepdims=True)
    weight = 1 / (sigma * (1 + chi2 / ROBUST**2)) ** 2  # (K, E, 3)
    J = np.zeros((2, *residual.shape, 3))
    for end, (sign, arm) in enumerate(zip((-1.0, 1.0), arms, strict=True)):
        J[end, ..., 0, 0] = J[end, ..., 1, 1] = J[end, ..., 2, 2] = sign
        J[end, ..., 1, 0], J[end, ..., 2, 0] = -sign * arm[..., 1], sign * arm[..., 0]
    weighted = np.swapaxes(J, -1, -2) * weight[..., None, :]
    return weighted[:, None] @ J[None], -(weighted @ residual[..., None])[..., 0]


def _solved(groups: Groups, H: Array, g: Array, information: Array, pull: Array) -> Array:
    """(K, G, 3) the change of the state; a large map's normal equations are sparse."""
    from scipy.sparse import bsr_array  # slow to import
    from scipy.sparse.linalg import spsolve

    K, G = g.shape[:2]
    ends = groups.edges.T
    for end in (0, 1):
        np.add.at(g.transpose(1, 0, 2), ends[end], pull[end].transpose(1, 0, 2))
    if G <= DENSE:
        joint = np.zeros((G, G, K, 3, 3))
        joint[np.arange(G), np.arange(G)] = H.transpose(1, 0, 2, 3)
        for m, n in ((0, 0), (0, 1), (1, 0), (1, 1)):
            np.add.at(joint, (ends[m], ends[n]), information[m, n].transpose(1, 0, 2, 3))
        square = joint.transpose(2, 0, 3, 1, 4).reshape(K, 3 * G, 3 * G)
        return np.asarray(np.linalg.solve(square, g.reshape(K, 3 * G, 1)).reshape(K, G, 3))
    for end in (0, 1):
        np.add.at(H.transpose(1, 0, 2, 3), ends[end], information[end, end].transpose(1, 0, 2, 3))
    row = np.concatenate((np.arange(G), ends[0], ends[1]))
    column = np.concatenate((np.arange(G), ends[1], ends[0]))
    order = np.lexsort((column, row))
    first = np.searchsorted(row[order], np.arange(G + 1))
    change = []
    for k in range(K):
        blocks = np.concatenate((H[k], information[0, 1, k], information[1, 0, k]))
        matrix = bsr_array((blocks[order], column[order], first), shape=(3 * G, 3 * G))
        change.append(spsolve(matrix.tocsc(), g[k].ravel()).reshape(G, 3))
    return np.array(change)
