"""The log likelihood ratio of a map under a rigid placement against chance, in nats.

Each S wall is either a wall of the plan, with a normal deviation from its line, or something else (clutter, or a wall
that is not in the plan). Under chance, A walls of this direction cross a random place with a density `rho` (walls per
metre). The map's precision is unknown and marginalised over.
"""

import numpy as np

from data.geometry import se2
from data.geometry.se2 import Array
from matching.search.scoring import BEND, SIGMA_HEADING, Fit, Pairing

# also used in compiled functions of `deformation.evidence`
SIGMAS = np.array([0.02, 0.04, 0.07, 0.12])  # metres across, equally likely beforehand
NOT_IN_PLAN = 0.3  # prior of an S wall, over its length in metres: cupboards are short
NOT_IN_PLAN_BOUNDS = (0.04, 0.3)
LEAST_DENSITY = 0.1  # walls per metre; a rare direction must not prove a place
END_SIGMAS = np.array([0.05, 0.15, 0.4])  # metres along, of the ends of walls
SEEN_TO_END = 0.6  # the others stop short, or run on where the plan has a corner
END_TRUST = 0.5  # exponent: two ends of a wall, and the walls that cross there, are not independent
SEEN = 0.3  # quality of a pair
SHOWN = 0.8  # metres; shorter walls may well vanish
ENTERED = 0.6
MOST_BENT = 9.0  # chi^2 of one room


def likelihood_ratios(pairing: Pairing, state: Array, fitted: Fit) -> Array:
    """(Ns, precisions) log likelihood ratios of each S wall on the plan against chance.

    `state` (1, G, 3) and its `fitted` pairs; the best pair of each S wall counts.
    """
    s, a = pairing.s, pairing.a
    n = np.arange(len(s))
    best = fitted.quality[:, 0].argmax(axis=1)
    j = pairing.partner[n, best]
    off = np.sum((fitted.placed[:, 0] - a.centre[j]) * a.normal[j], axis=-1)
    turned = se2.wrap(s.heading + state[0, pairing.group, 0] - a.heading[j])
    density = normal_density(off, SIGMAS)
    here = fitted.beside[n, 0, best] * np.exp(-0.5 * (turned / SIGMA_HEADING) ** 2)
    ratio = (here / chance_density(pairing)[n, a.building[j]])[:, None] * density
    known = s.known & a.known[j]
    length = np.maximum(2 * a.half[j], 1.0)[:, None]
    ends = np.ones((len(s), len(END_SIGMAS)))
    for side in (-1, 1):
        gap = fitted.along[n, 0, best] + side * (s.half - a.half[j])
        ends *= SEEN_TO_END * normal_density(gap, END_SIGMAS) * length + 1 - SEEN_TO_END
    ends = np.where(known[:, None], ends**END_TRUST, 1.0)
    other = np.clip(NOT_IN_PLAN / (2 * s.half), *NOT_IN_PLAN_BOUNDS)[:, None, None]
    both = (1 - other) * ratio[:, :, None] * ends[:, None, :] + other
    return np.asarray(np.log(both).reshape(len(s), -1))


def normal_density(x: Array, sigmas: Array) -> Array:
    """(N, sigmas) density of N(0, sigma) at x (N,)."""
    return np.asarray(np.exp(-0.5 * (x[:, None] / sigmas) ** 2) / (np.sqrt(2 * np.pi) * sigmas))


def chance_density(pairing: Pairing) -> Array:
    """(Ns, buildings) how many A walls of its direction an S wall meets per metre across, at a random place of each."""
    s, a = pairing.s, pairing.a
    real = np.isfinite(pairing.half)
    building = a.building[pairing.partner]
    met = np.where(real, 2 * (pairing.half + s.half[:, None]), 0.0)
    total = np.zeros((len(s), len(a.building_areas)))
    np.add.at(total, (np.arange(len(s))[:, None], building), met)
    return np.asarray(np.maximum(total / a.building_areas, LEAST_DENSITY))


def evidence(pairing: Pairing, state: Array, expected: Array, fitted: Fit) -> float:
    """Nats: all S walls, marginalised over precision, plus the completeness of rooms, minus the cost of deformation."""
    total = likelihood_ratios(pairing, state, fitted).sum(axis=0)
    bent = np.minimum((((state - expected)[0] / BEND) ** 2).sum(axis=1), MOST_BENT).sum()
    seen = completeness(pairing, pairing.table(fitted.quality))
    return float(np.logaddexp.reduce(total) - np.log(len(total)) + seen - 0.5 * bent)


def completeness(pairing: Pairing, quality: Array) -> float:
    """Nats for the A walls that the map should have: those of A rooms with most walls of some S room.

    An A room was either entered, so that most of its walls are observed, or seen through a door.
    """
    s, a = pairing.s, pairing.a
    at = np.where(quality.max(axis=1) > SEEN, a.room[quality.argmax(axis=1)], -1)
    both = (s.room >= 0) & (at >= 0)
    if not both.any():
        return 0.0
    votes = np.zeros((len(s.rooms), len(a.rooms)))
    np.add.at(votes, (s.room[both], at[both]), s.weight[both])
    homes = np.unique(votes.argmax(axis=1)[votes.max(axis=1) > 0])
    wall = (2 * a.half > SHOWN) & np.isin(a.room, homes)
    seen = quality.max(axis=0, initial=0.0) > SEEN
    count = np.stack([np.bincount(a.room[wall & of], minlength=len(a.rooms))[homes] for of in (seen, ~seen)])
    entered = np.log(ENTERED) + np.log(np.array([0.85, 0.15]) / 0.5) @ count
    glimpsed = np.log(1 - ENTERED) + np.log(np.array([0.4, 0.6]) / 0.5) @ count
    return float(np.logaddexp(entered, glimpsed).sum())
