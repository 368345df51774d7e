"""Decides between unique, ambiguous and none: whether the map is in the plan at all, and the margin over the runner-up.

A map of another building also has a best place. Its score grows with the plan's size, and the runner-up is close. The
odds were fitted by logistic regression to 3,000 maps of 1 to 9 rooms (`real`, `drift`, `mis_segmented`), of flats and
of generated buildings, matched with their own plans and with others.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from matching.engine.assignment import Pairs
from matching.engine.field import judge
from matching.engine.field_loops import SIGMA_SCORE
from matching.engine.hypotheses import Hypotheses
from matching.result import Status

LEAST_SURFACES = 5
PLACES_PER_M2 = 40.0  # that a vote can separate: four directions of the grid, a third of a metre
LEAST_MARGIN = float(np.log(199))  # nats over the runner-up: 99.5 % sure between the two
DOUBT = 0.6  # nats more for each unexplained wall: at another place as much may differ from the plan
OFFSET, SCORE, MARGIN, MISSED, PLACES = 5.68, 0.254, 0.147, -1.736, -0.656  # of the log odds, see `odds`
LEAST_ODDS = 4.5
MOST_MISSED = 10  # unexplained walls that count, at most: large maps have many cupboards and partitions
LEAST_FRACTION = 0.5  # of the map's walls, by length, that the plan explains
PER_WALL = (1.8, 2.4)  # nats of each wall that the plan explains, at least: of a map of few walls,
WALLS = (15, 30)  # and of one of many; a deformed mirror image often reaches less
OF_MISSED = 2.0  # nats that a wall costs which is not explained, about


@dataclass(frozen=True)
class Verdict:
    """The status with its reason; `probability` is that of the best placement."""

    status: Status
    reason: str
    probability: float


def verify(found: Hypotheses, pairs: Pairs) -> Verdict:
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


def odds(found: Hypotheses, fraction: float) -> float:
    """Returns the log odds that the map is in the plan, which explains a fraction of its walls.

    They rise with the evidence with conservative ends and with the margin over wrong places (places as good as the best
    one are left out), and fall with unexplained walls and the number of places.
    """
    walls, conservative = len(found.scene.s), found.conservative
    places = np.log(PLACES_PER_M2 * sum(a.area for a in found.scene.plan.storeys))
    margin = min(walls, *(conservative[0] - conservative[conservative <= conservative[0] - LEAST_MARGIN]), np.inf)
    missed = min((1 - fraction) * walls, MOST_MISSED)
    return float(OFFSET + SCORE * conservative[0] + MARGIN * margin + MISSED * missed + PLACES * places)


def unexplained(fraction: float, least: float) -> str:
    """The reason where the plan explains too small a fraction of the map."""
    share = f"{100 * fraction:.0f} % of its walls' length at the best place"
    return f"the plan does not explain the map: {share}, of at least {100 * least:.0f} % needed"


def matched(pairs: Pairs, walls: int) -> str:
    """How many of the map's `walls` and rooms have a match."""
    rooms = len(pairs.rooms)
    return f"{len(pairs.surfaces)} of {walls} wall surfaces and {rooms} {'room' if rooms == 1 else 'rooms'} matched"


def places_named(floors: Sequence[str]) -> str:
    """Places, each on one of `floors`: how many, and on how many storeys."""
    distinct = len(set(floors))
    if distinct == 1:
        return f"{len(floors)} places"
    return f"{distinct} storeys" if distinct == len(floors) else f"{len(floors)} places on {distinct} storeys"
