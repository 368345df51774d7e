"""How much more likely the map is under a placement than by chance, in nats.

Each S wall is either a wall of the plan, off its line by a normal deviation, or something else (clutter, or a
wall that is not in the plan). Against it stands chance: A walls of this direction lie across a random place
with a density `rho` (walls a metre). The precision of the map is not known, so it is marginalised over.
"""

import numpy as np

from matching import se2
from matching.scoring import BEND, SIGMA_HEADING, Fit, Pairing
from matching.se2 import Array

SIGMAS = np.array([0.02, 0.04, 0.07, 0.12])  # metres across, equally likely beforehand
NOT_IN_PLAN = 0.2  # prior of an S wall
LEAST_DENSITY = 0.1  # walls a metre; rare directions shall not be proof of a place
MOST_BENT = 9.0  # chi^2 of one room


def likelihood_ratios(pairing: Pairing, state: Array, fitted: Fit) -> Array:
    """(Ns, sigmas) log likelihood ratio, wall on plan against chance, of each S wall for each precision.

    `state` (1, G, 3) and its `fitted` pairs: the best pair of each S wall speaks.
    """
    s, a = pairing.s, pairing.a
    n = np.arange(len(s))
    best = fitted.quality[:, 0].argmax(axis=1)
    j = pairing.partner[n, best]
    off = np.sum((fitted.placed[:, 0] - a.centre[j]) * a.normal[j], axis=-1)
    turned = se2.wrap(s.heading + state[0, pairing.group, 0] - a.heading[j])
    density = np.exp(-0.5 * (off[:, None] / SIGMAS) ** 2) / (np.sqrt(2 * np.pi) * SIGMAS)
    here = fitted.beside[n, 0, best] * np.exp(-0.5 * (turned / SIGMA_HEADING) ** 2)
    ratio = here[:, None] * density / chance_density(pairing)[:, None]
    return np.asarray(np.log((1 - NOT_IN_PLAN) * ratio + NOT_IN_PLAN))


def chance_density(pairing: Pairing) -> Array:
    """(Ns,) how many A walls of its direction an S wall meets a metre across, at a random place."""
    length = np.where(np.isfinite(pairing.half), 2 * (pairing.half + pairing.s.half[:, None]), 0.0).sum(axis=1)
    size = np.ptp(pairing.a.centre, axis=0) + 1.0
    return np.asarray(np.maximum(length / np.prod(size), LEAST_DENSITY))


def evidence(pairing: Pairing, state: Array, expected: Array, fitted: Fit) -> float:
    """Nats: all S walls' ratios, precision marginalised, less what the bending of the map costs."""
    total = likelihood_ratios(pairing, state, fitted).sum(axis=0)
    bent = np.minimum((((state - expected)[0] / BEND) ** 2).sum(axis=1), MOST_BENT).sum()
    return float(np.logaddexp.reduce(total) - np.log(len(SIGMAS)) - 0.5 * bent)
