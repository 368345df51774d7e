"""Local motions: pairs of proposed wall matches vote for motions of parts of the map.

Two S walls that are not parallel and an A wall for each determine a motion: the yaw follows from the normals, the
position from the two lines. The votes of a part of the map and its direct neighbours are gathered at its centre, where
their motions differ little, however much the whole map has drifted.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from data.geometry.se2 import Array
from data.geometry.se2_compiled import wrapped
from matching.arrays import Index
from matching.engine.field import Fields, Scene, rigid_state
from matching.engine.field_loops import SIGMA_ALONG
from matching.engine.proposals import TopK
from matching.engine.votes import ascending, most_of

OPENING = float(np.radians(10))  # the angles between two S walls and their A walls differ by less
LEAST_ANGLE = float(np.radians(35))
YAW_BIN, PLACE_BIN = np.radians(8), 0.8
SIGMA = 0.3  # metres across: neighbours' motions differ
SIGMA_TURN = float(np.radians(6))
SIGMA_BEYOND = 0.8  # metres beyond the ends
FAR = 9.0  # deviations; nothing is left of what is further off
MOST_PLACES = 40  # of one part
MOST_PARTS = 8
LEAST_SCORE = 1e-3  # of a proposal
LEAST_WEIGHT = 1e-6  # of a vote
LEAST_WORTH = 0.25  # of the best one's; beyond the fewest, others are no seeds


@dataclass(frozen=True)
class LocalMotions:
    """M motions (M, 3) between own frames, each of a part of the map into a storey, with its weight of evidence
    (M,).
    """

    group: Index
    storey: Index
    motion: Array
    worth: Array


@dataclass(frozen=True)
class _Votes:
    group: Index
    storey: Index
    motions: Array  # (V, 4) the motion's yaw, its weight, and its translation


def local_motions(scene: Scene, proposals: TopK) -> LocalMotions:
    """Returns the motions with most votes, for several parts of the map and for all of it, best first."""
    votes = _votes(scene, proposals)
    if not len(votes.motions):
        return LocalMotions(*(np.zeros(0, dtype=np.int64),) * 2, np.zeros((0, 3)), np.zeros(0))
    parts, member = _parts(scene, proposals)
    heard = [n for n in range(len(parts)) if member[n][votes.group].any()]
    centre = scene.groups.centre
    found = [_gathered(votes.group, votes.storey, votes.motions, member[n], *centre[parts[n]]) for n in heard]
    storey, motion = (np.concatenate([f[k] for f in found]) for k in (0, 1))
    group = np.repeat(parts[heard], [len(f[0]) for f in found])
    worth = np.concatenate([_worth(scene, proposals, *f, member[n]) for n, f in zip(heard, found, strict=True)])
    order = np.argsort(-worth, kind="stable")
    return LocalMotions(group[order], storey[order], motion[order], worth[order])


def _votes(scene: Scene, proposals: TopK) -> _Votes:
    s, plan = scene.s, scene.plan
    pair, motions = _voted(
        s.heading, s.half, s.centre, s.normal, s.weight, scene.groups.of_wall, plan.lines, plan.centre, plan.storey,
        proposals.partner, proposals.score,
    )  # fmt: skip
    return _Votes(scene.groups.of_wall[pair[:, 0]], plan.storey[pair[:, 1]], motions)


@compiled
def _voted(
    heading: Array, half: Array, centre: Array, normal: Array, size: Array, of_wall: Index, lines: Array,
    a_centre: Array, a_storey: Index, partner: Index, score: Array,
) -> tuple[Index, Array]:  # fmt: skip
    """(V, 2) one of the walls of each vote and its partner, and (V, 4) its yaw, its weight and its shift."""
    most = int((np.bincount(of_wall) ** 2).sum()) // 2 * partner.shape[1] ** 2
    pair, motions, count = np.empty((most, 2), dtype=np.int64), np.empty((most, 4)), 0
    for i in range(len(heading)):
        for k in range(i + 1, len(heading)):
            if of_wall[i] != of_wall[k]:
                continue
            turn = wrapped(heading[k] - heading[i])
            x, y = centre[k, 0] - centre[i, 0], centre[k, 1] - centre[i, 1]
            if abs(abs(turn) - np.pi / 2) >= np.pi / 2 - LEAST_ANGLE:
                continue
            along = (x * normal[k, 0] + y * normal[k, 1]) / np.sin(turn)  # the crossing's place on each wall
            back = (x * normal[i, 0] + y * normal[i, 1]) / np.sin(turn)
            if abs(along) >= 1.5 * half[i] + 1.5 or abs(back) >= 1.5 * half[k] + 1.5:
                continue
            x, y = centre[i, 0] - along * normal[i, 1], centre[i, 1] + along * normal[i, 0]
            for u in range(partner.shape[1]):
                for v in range(partner.shape[1]):
                    j, m = partner[i, u], partner[k, v]
                    if j < 0 or m < 0 or a_storey[j] != a_storey[m] or min(score[i, u], score[k, v]) < LEAST_SCORE:
                        continue
                    opening = wrapped(lines[m, 1] - lines[j, 1])
                    off = wrapped(opening - turn)
                    if abs(off) >= OPENING:
                        continue
                    yaw = wrapped(lines[j, 1] - heading[i] + off / 2)
                    # The crossing of the two A lines, from A wall j along its tangent.
                    away_x, away_y = a_centre[m, 0] - a_centre[j, 0], a_centre[m, 1] - a_centre[j, 1]
                    run = away_x * lines[m, 2] + away_y * lines[m, 3]
                    run /= np.sin(opening)
                    cos, sin = np.cos(yaw), np.sin(yaw)
                    shift_x = a_centre[j, 0] - run * lines[j, 3] - (cos * x - sin * y)
                    shift_y = a_centre[j, 1] + run * lines[j, 2] - (sin * x + cos * y)
                    weight = score[i, u] * score[k, v] * np.sqrt(size[i] * size[k])
                    for wall, line in ((i, lines[j]), (k, lines[m])):
                        at_x = cos * centre[wall, 0] - sin * centre[wall, 1] + shift_x
                        at_y = sin * centre[wall, 0] + cos * centre[wall, 1] + shift_y
                        slid = _beyond(abs(at_y * line[2] - at_x * line[3] - line[5]), half[wall], line[0])
                        weight *= np.exp(-0.5 * (slid / (2 * SIGMA_ALONG)) ** 2)
                    if weight > LEAST_WEIGHT:
                        pair[count, 0], pair[count, 1] = i, j
                        motions[count, 0], motions[count, 1] = yaw, weight
                        motions[count, 2], motions[count, 3] = shift_x, shift_y
                        count += 1
    return pair[:count].copy(), motions[:count].copy()


@compiled
def _beyond(along: float, half: float, a_half: float) -> float:
    """How far a wall of the map extends beyond one of the plan; its ends are inaccurate."""
    return max(along - abs(a_half - half), 0.0)


def _parts(scene: Scene, proposals: TopK) -> tuple[Index, Array]:
    """The groups around which motions are searched, those with the most certain proposals, apart from each other.

    Also returns (parts, G) which groups vote with each. The last part is the whole map.
    """
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


@compiled
def _gathered(
    group: Index, storey: Index, motions: Array, member: NDArray[np.bool_], x: float, y: float
) -> tuple[Index, Array]:
    """(K,) storeys and (K, 3) motions: means of the fullest bins of the members' votes at a point."""
    of = np.flatnonzero(member[group])
    value, cell, key = np.empty((len(of), 4)), np.empty((len(of), 4), dtype=np.int64), np.zeros(len(of), dtype=np.int64)
    for n in range(len(of)):
        yaw, weight, shift_x, shift_y = motions[of[n]]
        cos, sin = np.cos(yaw), np.sin(yaw)
        value[n] = 1.0, yaw, cos * x - sin * y + shift_x, sin * x + cos * y + shift_y
        cell[n, 0], cell[n, 1] = storey[of[n]], np.floor((yaw + np.pi) / YAW_BIN)
        cell[n, 2], cell[n, 3] = np.floor(value[n, 2] / PLACE_BIN), np.floor(value[n, 3] / PLACE_BIN)
        value[n] *= weight
    for d in range(4):
        low = cell[:, d].min()
        key = key * (cell[:, d].max() - low + 1) + cell[:, d] - low
    total, floor, bins, last = np.zeros((len(of), 4)), np.empty(len(of), dtype=np.int64), 0, -1
    for n in ascending(key):
        bins += key[n] != last
        total[bins - 1] += value[n]
        floor[bins - 1], last = cell[n, 0], key[n]
    best = most_of(total[:bins, 0], np.arange(bins), MOST_PLACES)
    motion = np.empty((len(best), 3))
    for n in range(len(best)):
        _, yaw, u, v = total[best[n]] / total[best[n], 0]
        cos, sin = np.cos(yaw), np.sin(yaw)
        motion[n] = yaw, u - (cos * x - sin * y), v - (sin * x + cos * y)
    return floor[best], motion


def _worth(scene: Scene, proposals: TopK, storey: Index, motion: Array, member: Array) -> Array:
    """(M,) weight of the proposed pairs of a part's walls that a motion aligns."""
    s, plan = scene.s, scene.plan
    chosen = np.flatnonzero(member[scene.groups.of_wall])
    return np.asarray(_upon(
        chosen, s.heading, s.half, s.centre, s.weight, plan.lines, plan.storey, proposals.partner, proposals.score,
        storey, motion,
    ))  # fmt: skip


@compiled
def _upon(
    chosen: Index, heading: Array, half: Array, centre: Array, weight: Array, lines: Array, a_storey: Index,
    partner: Index, score: Array, storey: Index, motion: Array,
) -> Array:  # fmt: skip
    """See `_worth`, for the `chosen` walls."""
    worth = np.zeros(len(motion))
    for n in range(len(motion)):
        cos, sin = np.cos(motion[n, 0]), np.sin(motion[n, 0])
        for i in chosen:
            x = cos * centre[i, 0] - sin * centre[i, 1] + motion[n, 1]
            y = sin * centre[i, 0] + cos * centre[i, 1] + motion[n, 2]
            best = 0.0
            for p in range(partner.shape[1]):
                j = partner[i, p]
                if j < 0 or score[i, p] < LEAST_SCORE or a_storey[j] != storey[n]:
                    continue
                across = x * lines[j, 2] + y * lines[j, 3] - lines[j, 4]
                if abs(across) > FAR * SIGMA:
                    continue
                along = abs(y * lines[j, 2] - x * lines[j, 3] - lines[j, 5])
                turned, beyond = wrapped(heading[i] - lines[j, 1] + motion[n, 0]), _beyond(along, half[i], lines[j, 0])
                off = across**2 / SIGMA**2 + turned**2 / SIGMA_TURN**2 + beyond**2 / SIGMA_BEYOND**2
                best = max(best, np.exp(-0.5 * off) * np.sqrt(score[i, p]))
            worth[n] += weight[i] * best
    return worth


def seeds(scene: Scene, found: LocalMotions, fewest: int, most: int) -> tuple[Fields, Index]:
    """Returns the best distinct motions as rigid fields, and the group (K,) for which each is most certain."""
    groups = scene.groups
    chosen = _seeds(groups.centre, groups.hops, found.group, found.storey, found.motion, found.worth, fewest, most)
    return Fields(found.storey[chosen], rigid_state(scene, found.motion[chosen])), found.group[chosen]


@compiled
def _seeds(
    centre: Array, hops: Index, group: Index, storey: Index, motion: Array, worth: Array, fewest: int, most: int
) -> Index:
    """See `seeds`; indices of motions."""
    kept, count = np.empty(most, dtype=np.int64), 0
    for n in range(len(worth)):
        if count == most or (count >= fewest and worth[n] < LEAST_WORTH * worth[0]):
            break
        x, y = _moved(motion, n, centre, group[n])
        new = True
        for m in kept[:count]:
            u, v = _moved(motion, m, centre, group[n])
            slack = np.sqrt(1.0 + hops[group[n], group[m]])
            near = np.hypot(u - x, v - y) < 0.4 * slack
            near = near and abs(wrapped(motion[m, 0] - motion[n, 0])) < np.radians(4) * slack
            new = new and not (near and storey[m] == storey[n])
        if new:
            kept[count] = n
            count += 1
    return kept[:count].copy()


@compiled
def _moved(motion: Array, n: int, point: Array, g: int) -> tuple[float, float]:
    """Where one of the motions (M, 3) puts one of the points (G, 2)."""
    cos, sin = np.cos(motion[n, 0]), np.sin(motion[n, 0])
    x, y = point[g, 0], point[g, 1]
    return cos * x - sin * y + motion[n, 1], sin * x + cos * y + motion[n, 2]
