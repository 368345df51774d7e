"""Decides between unique, ambiguous and none from the evidence of the best placement and its margin over the runner-up.

The limits were set on S-graphs with the noise of real scans of 22 floors and an office building, matched with their own
plans and with others. They exceed what the best of thousands of wrong places reaches.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from matching.arrays import Walls
from matching.result import Status
from matching.search.assignment import Pairs
from matching.engine.confidence import place_probability
from matching.search.hypotheses import Placement

LEAST_SURFACES = 5
LEAST_FRACTION = 0.6  # of the map's walls, by length, that the plan explains
LEAST_EVIDENCE = 5.0  # nats above what the best of all places reaches by chance,
LEAST_EVIDENCE_PER_WALL = 1.0  # and for each wall of the map: a plan that is alike in parts is not the plan
LEAST_MARGIN = 4.0  # nats over the runner-up,
MARGIN_SHARE = 0.12  # and of the evidence: two nearly equal places differ by the same noise everywhere
PLACES_PER_M2 = 40.0  # that a vote can separate: four directions of the grid, a third of a metre


@dataclass(frozen=True)
class Verdict:
    """The status with its reason; `probability` is that of the best placement."""

    status: Status
    reason: str
    probability: float


def verify(placements: list[Placement], storeys: list[Walls], pairs: Pairs) -> Verdict:
    """Returns the verdict on placements, best first, at least one.

    `pairs` are the matches of the first, `storeys` all that were searched.
    """
    best = placements[0]
    walls = len(best.explained)
    by_chance = float(np.log(PLACES_PER_M2 * sum(a.area for a in storeys)))
    probability = place_probability(np.array([p.score for p in placements]), by_chance, walls)
    own = matched(pairs, walls)
    if best.fraction < LEAST_FRACTION:
        return Verdict("none", unexplained(best.fraction, LEAST_FRACTION), probability)
    least = by_chance + LEAST_EVIDENCE + LEAST_EVIDENCE_PER_WALL * walls
    if best.score < least or len(pairs.surfaces) < LEAST_SURFACES:
        return Verdict("none", f"too little evidence at the best place ({own}): see more rooms", probability)
    margin = LEAST_MARGIN + MARGIN_SHARE * best.score
    alternatives = [p for p in placements if p.score > best.score - margin]
    if len(alternatives) > 1:
        places = places_named([str(p.storey.floor) for p in alternatives])
        return Verdict("ambiguous", f"{places} explain the map about equally well ({own})", probability)
    return Verdict("unique", f"{own}; no other place explains the map nearly as well", probability)


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
