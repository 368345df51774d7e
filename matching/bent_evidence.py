"""How much more likely the map is under a field of motions than by chance, in nats.

As `evidence` for a rigid placement: each S wall is a wall of the plan, off its line by a normal deviation whose
size is marginalised over, or something else; chance is an A wall of its direction met at a random place. Beyond
that the walls of an S room are those of one A room, seldom of two, which the map took for one; the A rooms' walls
should be in the map, and doors where the plan has them; and the field pays for how it bends between neighbours.
"""

from dataclasses import dataclass

import numpy as np

from matching.bent_doors import door_evidence
from matching.evidence import (
    END_SIGMAS,
    END_TRUST,
    ENTERED,
    LEAST_DENSITY,
    NOT_IN_PLAN,
    NOT_IN_PLAN_BOUNDS,
    SEEN,
    SEEN_TO_END,
    SHOWN,
    SIGMAS,
)
from matching.field import Fields, Judged, Scene, chi2, judge
from matching.scoring import SIGMA_HEADING, SIGMA_SCORE
from matching.se2 import Array
from matching.walls import Index

MOST_STRAINED = 50.0  # chi^2 of one pair of neighbours: rooms are not torn from one another
LEAST_HERE, MOST_OFF = 1e-6, 0.8  # pairs that lie less beside each other, or further off (metres), are as good as none
ELSEWHERE = 0.1  # how likely a wall is that of another A room than its S room's
TWO_IN_ONE = 0.05  # of the S rooms are two A rooms


@dataclass(frozen=True)
class _Homes:
    """Of K fields and R S rooms the A rooms, of the field's storey, where most and second most of the walls are."""

    first: Index  # (K, R), -1 for none
    second: Index  # (K, R)


@dataclass(frozen=True)
class Chance:
    """The storey and building whose walls stand for those that are met by chance: one for all fields of a scene.

    Were it each field's own, then of two equal places the one in the emptier storey would seem the better.
    """

    storey: int
    building: int

    @staticmethod
    def of(scene: Scene, fields: Fields, table: Index) -> "Chance":
        """Where most walls of the first field are, by what they explain."""
        quality = judge(scene, table[:1], fields.state[:1], SIGMA_SCORE).quality[0]
        storey = int(fields.storey[0])
        building = scene.plan.storeys[storey].building[np.where(table[0] >= 0, table[0] - scene.plan.first[storey], 0)]
        explained = np.bincount(building.ravel(), (quality * scene.s.half[:, None]).ravel())
        return Chance(storey, int(explained.argmax()))


def evidence(scene: Scene, fields: Fields, table: Index, chance: Chance) -> Array:
    """(K,) nats, comparable between fields of one scene, in whatever storey."""
    now = judge(scene, table, fields.state, SIGMA_SCORE)
    homes = _homes(scene, table, now.quality)
    walls = _of_walls(scene, fields, table, now, homes, chance)
    seen = [
        _completeness(scene, int(fields.storey[k]), table[k], now.quality[k], homes.first[k])
        for k in range(len(fields))
    ]
    told = door_evidence(scene, fields, homes.first)
    return np.asarray(walls + np.array(seen) + told - 0.5 * bending(scene, fields))


def bending(scene: Scene, fields: Fields) -> Array:
    """(K,) chi^2 of a chain of rooms, from the mean of all pairs of neighbours: they form circles, drift does not."""
    groups = scene.groups
    if not len(groups.edges):
        return np.zeros(len(fields))
    each = np.minimum(chi2(groups, fields.state), MOST_STRAINED)
    return np.asarray(each.mean(axis=1) * (len(groups) - 1))


def _homes(scene: Scene, table: Index, quality: Array) -> _Homes:
    s, plan = scene.s, scene.plan
    rooms = max((len(a.rooms) for a in plan.storeys), default=0)
    K, R = len(table), len(s.rooms)
    votes = np.zeros((K, R + 1, rooms + 1))
    best = quality.argmax(axis=2)[..., None]
    j = np.take_along_axis(table, best, axis=2)[..., 0]
    sure = np.take_along_axis(quality, best, axis=2)[..., 0]
    np.add.at(votes, (np.arange(K)[:, None], s.room[None], plan.room[j]), np.where(sure > SEEN, s.weight * sure, 0.0))
    votes = votes[:, :R, :rooms]
    if not votes.size:
        return _Homes(np.full((K, R), -1), np.full((K, R), -1))
    first = votes.argmax(axis=2)
    most = np.take_along_axis(votes, first[..., None], axis=2)[..., 0]
    np.put_along_axis(votes, first[..., None], 0.0, axis=2)
    second = np.where(votes.max(axis=2) > 0, votes.argmax(axis=2), -1)
    return _Homes(np.where(most > 0, first, -1), second)


@dataclass(frozen=True)
class _Ratios:
    """Likelihood ratios against chance, E of pairs that may be, for each precision; sorted by `row` (k Ns + i)."""

    row: Index  # (E,)
    wall: Index  # (E,) of A
    ratio: Array  # (E, precisions)


def _of_walls(scene: Scene, fields: Fields, table: Index, now: Judged, homes: _Homes, chance: Chance) -> Array:
    """(K,) nats of all S walls, precisions marginalised over."""
    s, plan = scene.s, scene.plan
    found = _ratios(scene, fields, table, now, chance)
    K, N = table.shape[:2]
    other = np.clip(NOT_IN_PLAN / (2 * s.half), *NOT_IN_PLAN_BOUNDS)[None, :, None]
    at, own = plan.room[found.wall], np.append(np.arange(len(s.rooms)), -1)[s.room]  # -1 stays the last
    one, two = (
        np.pad(h, ((0, 0), (0, 1)), constant_values=-1)[:, own].ravel()[found.row] for h in (homes.first, homes.second)
    )
    free = (at < 0) | (s.room < 0)[found.row % N] | (one < 0)
    first = np.flatnonzero(np.append(True, np.diff(found.row) > 0)[: len(found.row)])
    total = []
    for home in (at == one, (at == one) | (at == two)):
        best = np.zeros((K * N, found.ratio.shape[1]))
        if len(first):
            likely = found.ratio * np.where(free | home, 1.0, ELSEWHERE)[:, None]
            best[found.row[first]] = np.maximum.reduceat(likely, first, axis=0)
        total.append(np.log((1 - other) * best.reshape(K, N, -1) + other))
    member = (s.room[None] == np.arange(len(s.rooms))[:, None]).astype(float)  # (R, Ns)
    rooms = np.logaddexp(member @ total[0] + np.log(1 - TWO_IN_ONE), member @ total[1] + np.log(TWO_IN_ONE)).sum(axis=1)
    stray = total[0][:, s.room < 0].sum(axis=1)
    return np.asarray(np.logaddexp.reduce(rooms + stray, axis=1) - np.log(found.ratio.shape[1]))


def _ratios(scene: Scene, fields: Fields, table: Index, now: Judged, chance: Chance) -> _Ratios:
    s, plan = scene.s, scene.plan
    here = now.beside * np.exp((-0.5 / SIGMA_HEADING**2) * now.turned**2)
    k, i, p = np.nonzero((here > LEAST_HERE) & (np.abs(now.across) < MOST_OFF))
    j, across, along = table[k, i, p], now.across[k, i, p], now.along[k, i, p]
    density = np.exp(-0.5 * (across[:, None] / SIGMAS) ** 2) / (np.sqrt(2 * np.pi) * SIGMAS)
    ratio = (here[k, i, p] / _met(scene, fields, chance)[k, i])[:, None] * density
    half = plan.half[j]
    ends = np.ones((len(j), len(END_SIGMAS)))
    length = np.maximum(2 * half, 1.0)[:, None]
    for side in (-1, 1):
        gap = (along + side * (s.half[i] - half))[:, None]
        normal = np.exp(-0.5 * (gap / END_SIGMAS) ** 2) / (np.sqrt(2 * np.pi) * END_SIGMAS)
        ends *= SEEN_TO_END * normal * length + 1 - SEEN_TO_END
    ends = np.where((s.known[i] & plan.known[j])[:, None], ends**END_TRUST, 1.0)
    return _Ratios(k * len(s) + i, j, (ratio[:, :, None] * ends[:, None, :]).reshape(len(j), -1))


def _yaw(fields: Fields) -> Array:
    yaw = fields.state[..., 0]
    return np.asarray(np.arctan2(np.sin(yaw).mean(axis=1), np.cos(yaw).mean(axis=1)))


def _met(scene: Scene, fields: Fields, chance: Chance) -> Array:
    """(K, Ns) how many A walls of its direction an S wall meets a metre across, at a random place of the building;
    directions are taken by degrees."""
    s, storeys = scene.s, scene.plan.storeys
    a = storeys[chance.storey]
    count, half = scene.plan.met[chance.storey][:, chance.building]
    turned = np.array([storeys[int(st)].T_graph_own[0] for st in fields.storey]) - a.T_graph_own[0]
    own = np.round(np.degrees(s.heading + (_yaw(fields) + turned)[:, None])).astype(np.int64) % 360
    met = 2 * (half[own] + count[own] * s.half) / a.building_areas[chance.building]
    return np.asarray(np.maximum(met, LEAST_DENSITY))


def _completeness(scene: Scene, storey: int, table: Index, quality: Array, home: Index) -> float:
    """Nats of the A walls that the map should show: of the A rooms where most walls of some S room are.

    An A room was either entered, and most of its walls are seen, or glimpsed through a door.
    """
    a, first = scene.plan.storeys[storey], int(scene.plan.first[storey])
    homes = np.unique(home[home >= 0])
    wall = (2 * a.half > SHOWN) & np.isin(a.room, homes)
    seen = np.zeros(len(a), dtype=bool)
    seen[table[quality > SEEN] - first] = True
    count = np.stack([np.bincount(a.room[wall & of], minlength=len(a.rooms))[homes] for of in (seen, ~seen)])
    entered = np.log(ENTERED) + np.log(np.array([0.85, 0.15]) / 0.5) @ count
    glimpsed = np.log(1 - ENTERED) + np.log(np.array([0.4, 0.6]) / 0.5) @ count
    return float(np.logaddexp(entered, glimpsed).sum())
