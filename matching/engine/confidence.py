"""Calibrated confidences: the probability of a placement, and of a match given the placement.

The parameters are fitted by maximum likelihood to 1,900 answers on generated plans and plans of flats: `real`, `drift`
and `mis_segmented` maps of one room up to a whole floor, a quarter of them of another building. The form is that of
J. Platt, "Probabilistic outputs for support vector machines", 1999.
"""

import math

import numpy as np

from data.geometry.se2 import Array

ALTERNATIVE_SCALE = 1.0  # nats of evidence that count as one, between two places
NOWHERE_SCALE = 1.5  # and between a place and none
NOWHERE = -6.0  # nats above chance, of a map that is in no place of the plan,
NOWHERE_PER_WALL = 0.95  # and for each of its walls: plans are alike in parts
ROOM = (1.0, 3.4)  # offset and slope, in the odds of the share
SURFACE = (1.6, 2.4)


def place_probability(scores: Array, by_chance: float, walls: int) -> float:
    """The probability that the first placement is the true one, from the evidence (K,) in nats, best first.

    The alternatives are the other placements, and that the map is in none: the best of exp(by_chance) wrong places
    reaches that much evidence by chance, and more with every wall of the map.
    """
    alternatives = np.exp((scores[1:] - scores[0]) / ALTERNATIVE_SCALE).sum()
    nowhere = (by_chance + NOWHERE + NOWHERE_PER_WALL * walls - scores[0]) / NOWHERE_SCALE
    return float(1 / (1 + alternatives + np.exp(np.minimum(nowhere, 50.0))))


def room_confidence(share: float) -> float:
    """The confidence of a room pair given the placement, from its share of the merit of all candidates."""
    return _probability(share, *ROOM)


def surface_confidence(share: float) -> float:
    """The same for a surface pair."""
    return _probability(share, *SURFACE)


def _probability(share: float, offset: float, slope: float) -> float:
    return 1 / (1 + ((1 - share) / share) ** slope * math.exp(-offset))
