"""How much more likely the map is under a field of motions than by chance, in nats.

As `evidence` for a rigid placement: each S wall is a wall of the plan, off its line by a normal deviation whose
size is marginalised over, or something else; chance is an A wall of its direction met at a random place. The
field pays for how it bends between neighbours.
"""

import numpy as np

from matching import se2
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
)  # fmt: skip
from matching.field import STEP, Fields, Judged, Scene, judge, strain
from matching.scoring import SIGMA_HEADING, SIGMA_SCORE
from matching.se2 import Array
from matching.walls import Index, Walls

MOST_STRAINED = 12.0  # chi^2 of one pair of neighbours
DIRECTION = np.radians(15)


def evidence(scene: Scene, fields: Fields, table: Index) -> Array:
    """(K,) nats, comparable between fields of one scene, in whatever storey."""
    now = judge(scene, table, fields.state, SIGMA_SCORE)
    total = _ratios(scene, fields, table, now).sum(axis=1)  # (K, precisions)
    most = np.logaddexp.reduce(total, axis=1) - np.log(total.shape[1])
    seen = [_completeness(scene, int(fields.storey[k]), table[k], now.quality[k]) for k in range(len(fields))]
    return np.asarray(most + np.array(seen) - 0.5 * bending(scene, fields))


def bending(scene: Scene, fields: Fields) -> Array:
    """(K,) chi^2 of a chain of rooms, from the mean of all pairs of neighbours: they form circles, drift does not."""
    groups = scene.groups
    if not len(groups.edges):
        return np.zeros(len(fields))
    chi2 = ((strain(groups, fields.state) / (STEP * groups.slack[:, None])) ** 2).sum(axis=-1)
    each = np.minimum(chi2, MOST_STRAINED)
    return np.asarray(each.mean(axis=1) * (len(groups) - 1))


def _ratios(scene: Scene, fields: Fields, table: Index, now: Judged) -> Array:
    """(K, Ns, precisions) log likelihood ratio of each S wall's best pair against chance."""
    s, plan = scene.s, scene.plan
    best = now.quality.argmax(axis=2)[..., None]
    beside, off, along, turned = (
        np.take_along_axis(x, best, axis=2)[..., 0] for x in (now.beside, now.across, now.along, now.turned)
    )
    j = np.take_along_axis(table, best, axis=2)[..., 0]
    density = np.exp(-0.5 * (off[..., None] / SIGMAS) ** 2) / (np.sqrt(2 * np.pi) * SIGMAS)
    here = beside * np.exp(-0.5 * (turned / SIGMA_HEADING) ** 2)
    rho = np.stack([_chance(s, plan.storeys[st], yaw) for st, yaw in zip(fields.storey, _yaw(fields), strict=True)])
    ratio = (here / rho)[..., None] * density
    ends = np.ones((*off.shape, len(END_SIGMAS)))
    length = np.maximum(2 * plan.half[j], 1.0)[..., None]
    for side in (-1, 1):
        gap = (along + side * (s.half - plan.half[j]))[..., None]
        normal = np.exp(-0.5 * (gap / END_SIGMAS) ** 2) / (np.sqrt(2 * np.pi) * END_SIGMAS)
        ends *= SEEN_TO_END * normal * length + 1 - SEEN_TO_END
    ends = np.where((s.known & plan.known[j])[..., None], ends**END_TRUST, 1.0)
    other = np.clip(NOT_IN_PLAN / (2 * s.half), *NOT_IN_PLAN_BOUNDS)[None, :, None, None]
    both = (1 - other) * ratio[..., None] * ends[..., None, :] + other
    return np.asarray(np.log(both).reshape(*off.shape, -1))


def _yaw(fields: Fields) -> Array:
    yaw = fields.state[..., 0]
    return np.asarray(np.arctan2(np.sin(yaw).mean(axis=1), np.cos(yaw).mean(axis=1)))


def _chance(s: Walls, a: Walls, yaw: float) -> Array:
    """(Ns,) how many A walls of its direction an S wall meets a metre across, at a random place."""
    like = np.abs(se2.wrap(s.heading[:, None] + yaw - a.heading[None])) < DIRECTION
    met = 2 * (like @ a.half + like.sum(axis=1) * s.half)
    return np.asarray(np.maximum(met / a.extent.prod(), LEAST_DENSITY))


def _completeness(scene: Scene, storey: int, table: Index, quality: Array) -> float:
    """Nats of the A walls that the map should show: of the A rooms where most walls of some S room are.

    An A room was either entered, and most of its walls are seen, or glimpsed through a door.
    """
    s, a, first = scene.s, scene.plan.storeys[storey], int(scene.plan.first[storey])
    best = quality.argmax(axis=1)[:, None]
    j = np.take_along_axis(table, best, axis=1)[:, 0] - first
    sure = np.take_along_axis(quality, best, axis=1)[:, 0] > SEEN
    at = np.where(sure, a.room[j], -1)
    both = (s.room >= 0) & (at >= 0)
    if not both.any():
        return 0.0
    votes = np.zeros((len(s.rooms), len(a.rooms)))
    np.add.at(votes, (s.room[both], at[both]), s.weight[both])
    homes = np.unique(votes.argmax(axis=1)[votes.max(axis=1) > 0])
    wall = (2 * a.half > SHOWN) & np.isin(a.room, homes)
    seen = np.zeros(len(a), dtype=bool)
    seen[table[quality > SEEN] - first] = True
    count = np.stack([np.bincount(a.room[wall & of], minlength=len(a.rooms))[homes] for of in (seen, ~seen)])
    entered = np.log(ENTERED) + np.log(np.array([0.85, 0.15]) / 0.5) @ count
    glimpsed = np.log(1 - ENTERED) + np.log(np.array([0.4, 0.6]) / 0.5) @ count
    return float(np.logaddexp(entered, glimpsed).sum())
