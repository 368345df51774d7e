"""Decides between unique, ambiguous and none: whether the map is in the plan at all, and the margin over the runner-up.

A map of another building also has a best place. Its score grows with the plan's size, and the runner-up is close. The
odds were fitted by logistic regression to 3,000 maps of 1 to 9 rooms (`real`, `drift`, `mis_segmented`), of flats and
of generated buildings, matched with their own plans and with others.
"""

import numpy as np

from matching.engine.hypotheses import DeformedHypotheses
from matching.engine.field import judge
from matching.search.assignment import Pairs
from matching.search.scoring import SIGMA_SCORE
from matching.search.verification import LEAST_SURFACES, PLACES_PER_M2, Verdict, matched, places_named, unexplained

LEAST_MARGIN = float(np.log(199))  # nats over the runner-up: 99.5 % sure between the two
DOUBT = 0.6  # nats more for each unexplained wall: at another place as much may differ from the plan
OFFSET, SCORE, MARGIN, MISSED, PLACES = 5.68, 0.254, 0.147, -1.736, -0.656  # of the log odds, see `odds`
LEAST_ODDS = 4.5
MOST_MISSED = 10  # unexplained walls that count, at most: large maps have many cupboards and partitions
LEAST_FRACTION = 0.5  # of the map's walls, by length, that the plan explains
PER_WALL = (1.8, 2.4)  # nats of each wall that the plan explains, at least: of a map of few walls,
WALLS = (15, 30)  # and of one of many; a deformed mirror image often reaches less
OF_MISSED = 2.0  # nats that a wall costs which is not explained, about


def verify(found: DeformedHypotheses, pairs: Pairs) -> Verdict:
    """Returns the verdict on hypotheses, best first, at least one; `pairs` are the matches of the first."""
    s, plan = found.scene.s, found.scene.plan
    own = matched(pairs, len(s))
    now = judge(found.scene, found.table[:1], found.fields.state[:1], SIGMA_SCORE)
    fraction = float(s.half @ now.quality[0].max(axis=1, initial=0.0) / s.half.sum())
    log_odds = odds(found, fraction)
    missed = (1 - fraction) * len(s)
    margin = LEAST_MARGIN + DOUBT * missed
    behind = (found.score - found.score[0]) * LEAST_MARGIN / margin
    probability = float(1 / (np.exp(behind).sum() + np.exp(min(-log_odds, 50.0))))
    if fraction < LEAST_FRACTION:
        return Verdict("none", unexplained(fraction, LEAST_FRACTION), probability)
    near = np.flatnonzero(found.score > found.score[0] - margin)
    rough = found.conservative[0] + OF_MISSED * missed < (len(s) - missed) * np.interp(len(s), WALLS, PER_WALL)
    if log_odds < LEAST_ODDS or len(pairs.surfaces) < LEAST_SURFACES or rough:
        return Verdict("none", f"too little evidence at the best place ({own}): see more rooms", probability)
    if len(near) > 1:
        floors = [str(plan.storeys[int(found.fields.storey[k])].floor) for k in near]
        reason = f"{places_named(floors)} explain the map about equally well ({own})"
        return Verdict("ambiguous", reason, probability)
    return Verdict("unique", f"{own}; no other place explains the map nearly as well", probability)


def odds(found: DeformedHypotheses, fraction: float) -> float:
    """Returns the log odds that the map is in the plan, which explains a fraction of its walls.

    They rise with the evidence with conservative ends and with the margin over wrong places (places as good as the best
    one are left out), and fall with unexplained walls and the number of places.
    """
    walls, conservative = len(found.scene.s), found.conservative
    places = np.log(PLACES_PER_M2 * sum(a.area for a in found.scene.plan.storeys))
    margin = min(walls, *(conservative[0] - conservative[conservative <= conservative[0] - LEAST_MARGIN]), np.inf)
    missed = min((1 - fraction) * walls, MOST_MISSED)
    return float(OFFSET + SCORE * conservative[0] + MARGIN * margin + MISSED * missed + PLACES * places)
