"""Where a part of the map may lie: pairs of proposed wall matches vote for proper motions, part by part.

Two S walls that are not parallel and an A wall for each determine a motion: the yaw from the normals, the place
from the two lines. The votes of a part of the map and of its direct neighbours are gathered at its centre; near
one another their motions differ little, however far the map as a whole has drifted.
"""

from dataclasses import dataclass

import numpy as np

from matching import se2
from matching.corners import pairs_within
from matching.field import Fields, Scene, rigid_state
from matching.proposals import TopK
from matching.scoring import SIGMA_ALONG
from matching.se2 import Array
from matching.walls import Index

OPENING = np.radians(10)  # the angles between two S walls and their A walls differ by less
LEAST_ANGLE = np.radians(35)
YAW_BIN, PLACE_BIN = np.radians(8), 0.8
SIGMA = 0.3  # metres across: neighbours' motions differ
SIGMA_TURN = np.radians(6)
MOST_PLACES = 40  # of one part
MOST_PARTS = 8
LEAST_SCORE = 1e-3  # of a proposal
LEAST_WORTH = 0.25  # of the best one's; beyond the fewest, others are no seeds


@dataclass(frozen=True)
class LocalMotions:
    """M motions (M, 3) between own frames, each of a part of the map and into a storey, with its worth (M,)."""

    group: Index
    storey: Index
    motion: Array
    worth: Array


@dataclass(frozen=True)
class _Votes:
    group: Index
    storey: Index
    yaw: Array
    weight: Array
    shift: Array  # (V, 2) the motion's translation


def local_motions(scene: Scene, proposals: TopK) -> LocalMotions:
    """The motions most voted for, of several parts of the map and of all of it, best first."""
    votes = _votes(scene, proposals)
    if not len(votes.yaw):
        return LocalMotions(*(np.zeros(0, dtype=np.int64),) * 2, np.zeros((0, 3)), np.zeros(0))
    parts, member = _parts(scene, proposals)
    heard = [n for n in range(len(parts)) if member[n][votes.group].any()]
    found = [_gathered(scene, votes, int(parts[n]), member[n]) for n in heard]
    group, storey = (np.concatenate([f[k] for f in found]) for k in (0, 1))
    motion = np.concatenate([f[2] for f in found])
    worth = np.concatenate([_worth(scene, proposals, f[1], f[2], member[n]) for n, f in zip(heard, found, strict=True)])
    order = np.argsort(-worth, kind="stable")
    return LocalMotions(group[order], storey[order], motion[order], worth[order])


def _votes(scene: Scene, proposals: TopK) -> _Votes:
    s, plan, group = scene.s, scene.plan, scene.groups.of_wall
    i, k = pairs_within(group)
    turn = se2.wrap(s.heading[k] - s.heading[i])
    step = s.centre[k] - s.centre[i]
    with np.errstate(divide="ignore", invalid="ignore"):
        along = np.sum(step * s.normal[k], axis=-1) / np.sin(turn)  # the crossing's place on each wall
        back = np.sum(step * s.normal[i], axis=-1) / np.sin(turn)
    steep = np.abs(np.abs(turn) - np.pi / 2) < np.pi / 2 - LEAST_ANGLE
    met = steep & (np.abs(along) < 1.5 * s.half[i] + 1.5) & (np.abs(back) < 1.5 * s.half[k] + 1.5)
    i, k, turn, along = i[met], k[met], turn[met], along[met]
    width = proposals.partner.shape[1]
    pi, pk = (x.ravel() for x in np.meshgrid(np.arange(width), np.arange(width), indexing="ij"))
    j, m = proposals.partner[i][:, pi], proposals.partner[k][:, pk]
    sure = proposals.score >= LEAST_SCORE
    v, w = np.nonzero((j >= 0) & (m >= 0) & sure[i][:, pi] & sure[k][:, pk])
    i, k, j, m, turn, along = i[v], k[v], j[v, w], m[v, w], turn[v], along[v]
    opening = se2.wrap(plan.heading[m] - plan.heading[j])
    off = se2.wrap(opening - turn)
    kept = (plan.storey[j] == plan.storey[m]) & (np.abs(off) < OPENING)
    i, k, j, m, w, opening, off, along = (x[kept] for x in (i, k, j, m, w, opening, off, along))
    yaw = se2.wrap(plan.heading[j] - s.heading[i] + off / 2)
    corner = s.centre[i] + along[:, None] * s.tangent[i]
    # The crossing of the two A lines, from A wall j along its tangent.
    normal = np.stack((np.cos(plan.heading[m]), np.sin(plan.heading[m])), axis=-1)
    tangent = _tangent(plan.heading[j])
    run = np.sum((plan.centre[m] - plan.centre[j]) * normal, axis=-1) / np.sin(opening)
    shift = plan.centre[j] + run[:, None] * tangent - se2.rotate(yaw, corner)
    weight = proposals.score[i, pi[w]] * proposals.score[k, pk[w]] * np.sqrt(s.weight[i] * s.weight[k])
    motion = np.column_stack((yaw, shift))
    weight = weight * _beside(scene, i, j, motion) * _beside(scene, k, m, motion)
    kept = weight > 1e-6
    g = group[i[kept]]
    return _Votes(g, plan.storey[j[kept]], yaw[kept], weight[kept], shift[kept])


def _tangent(heading: Array) -> Array:
    return np.stack((-np.sin(heading), np.cos(heading)), axis=-1)


def _beside(scene: Scene, i: Index, j: Index, motion: Array) -> Array:
    """How well S walls i lie beside A walls j, along them, under each motion; their ends slide."""
    s, plan = scene.s, scene.plan
    step = se2.apply(motion, s.centre[i]) - plan.centre[j]
    along = np.abs(np.sum(step * _tangent(plan.heading[j]), axis=-1))
    beyond = np.maximum(along - np.abs(plan.half[j] - s.half[i]), 0.0)
    return np.asarray(np.exp(-0.5 * (beyond / (2 * SIGMA_ALONG)) ** 2))


def _parts(scene: Scene, proposals: TopK) -> tuple[Index, Array]:
    """The groups whose surroundings are tried, those of which the proposals are surest, apart from each other;
    and (parts, G) which groups vote with each. The last part is the whole map."""
    groups = scene.groups
    sure = np.bincount(groups.of_wall, scene.s.weight * proposals.score.max(axis=1, initial=0.0), len(groups))
    near = groups.hops <= 1
    sure = near @ sure
    free = np.ones(len(groups), dtype=bool)
    parts: list[int] = []
    while free.any() and len(parts) < MOST_PARTS:
        best = int(np.argmax(np.where(free, sure, -1.0)))
        parts.append(best)
        free &= ~near[best]
    middle = int(np.argmin(np.linalg.norm(groups.centre, axis=1)))
    return np.array([*parts, middle]), np.concatenate((near[parts], np.ones((1, len(groups)), dtype=bool)))


def _gathered(scene: Scene, votes: _Votes, part: int, member: Array) -> tuple[Index, Index, Array]:
    """(group, storey, motion) of the fullest bins of the members' votes."""
    of = np.nonzero(member[votes.group])[0]
    yaw, storey, weight = votes.yaw[of], votes.storey[of], votes.weight[of]
    motion = np.column_stack((yaw, votes.shift[of]))
    place = se2.apply(motion, scene.groups.centre[part])
    cell = np.column_stack((storey, np.floor((yaw + np.pi) / YAW_BIN), *np.floor(place / PLACE_BIN).T)).astype(np.int64)
    cell -= cell.min(axis=0)
    key = np.ravel_multi_index(tuple(cell.T), tuple(cell.max(axis=0) + 1))
    unique, inverse = np.unique(key, return_inverse=True)
    total = np.bincount(inverse, weight)
    best = np.argsort(-total, kind="stable")[:MOST_PLACES]
    mean = np.stack([np.bincount(inverse, weight * x)[best] / total[best] for x in (yaw, *place.T)], axis=-1)
    first = np.zeros(len(unique), dtype=np.int64)
    first[inverse] = np.arange(len(inverse))
    shift = mean[:, 1:] - se2.rotate(mean[:, 0], np.broadcast_to(scene.groups.centre[part], (len(best), 2)))
    return np.full(len(best), part), storey[first[best]], np.column_stack((mean[:, 0], shift))


def _worth(scene: Scene, proposals: TopK, storey: Index, motion: Array, member: Array) -> Array:
    """(M,) weight of the proposed pairs of the walls of a part that a motion lays upon each other."""
    s, plan = scene.s, scene.plan
    told = member[scene.groups.of_wall][:, None].astype(bool) & (proposals.score >= LEAST_SCORE)
    i, place = np.nonzero(told & (proposals.partner >= 0))
    if not len(i):
        return np.zeros(len(motion))
    j = proposals.partner[i, place]
    half, heading, n_x, n_y, off, off_along = plan.lines[j].T
    x, y = np.moveaxis(se2.apply(motion[:, None], s.centre[i]), -1, 0)
    across, along = x * n_x + y * n_y - off, np.abs(y * n_x - x * n_y - off_along)
    turned = se2.wrap(s.heading[i] - heading + motion[:, :1])
    beyond = np.maximum(along - np.abs(half - s.half[i]), 0.0)
    fits = np.exp((-0.5 / SIGMA**2) * across**2 - (0.5 / SIGMA_TURN**2) * turned**2 - (0.5 / 0.8**2) * beyond**2)
    value = np.where(plan.storey[j] == storey[:, None], fits * np.sqrt(proposals.score[i, place]), 0.0)
    first = np.flatnonzero(np.append(True, i[1:] != i[:-1]))
    return np.asarray(np.maximum.reduceat(value, first, axis=1) @ s.weight[i[first]])


def seeds(scene: Scene, found: LocalMotions, fewest: int, most: int) -> tuple[Fields, Index]:
    """The best motions that differ, as rigid fields, and the group (K,) in which each is sure."""
    kept: list[int] = []
    for n in range(len(found.worth)):
        centre = scene.groups.centre[found.group[n]]
        if len(kept) == most or (len(kept) >= fewest and found.worth[n] < LEAST_WORTH * found.worth[0]):
            break
        at = se2.apply(found.motion[n], centre)
        hops = scene.groups.hops[found.group[n], found.group[kept]] if kept else np.zeros(0)
        others = found.motion[kept]
        apart = np.linalg.norm(se2.apply(others, np.broadcast_to(centre, (len(kept), 2))) - at, axis=-1)
        turn = np.abs(se2.wrap(others[:, 0] - found.motion[n, 0]))
        slack = np.sqrt(1.0 + hops)
        alike = (apart < 0.4 * slack) & (turn < np.radians(4) * slack) & (found.storey[kept] == found.storey[n])
        if not alike.any():
            kept.append(n)
    chosen = np.array(kept, dtype=np.int64)
    return Fields(found.storey[chosen], rigid_state(scene, found.motion[chosen])), found.group[chosen]
