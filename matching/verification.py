"""Unique, ambiguous or none: the evidence of the best placement, and its margin over the runner-up."""

from dataclasses import dataclass

import numpy as np

from matching.complete import Pairs
from matching.hypotheses import Placement
from matching.result import Status

LEAST_SURFACES = 5
LEAST_ROOMS = 1
LEAST_FRACTION = 0.5
LEAST_SCORE = 5.0  # wall surfaces' worth
LEAST_MARGIN = 2.0  # wall surfaces' worth
NATS = 1.5  # log likelihood of one wall surface's worth


@dataclass(frozen=True)
class Verdict:
    """`probability` is that of the best placement among those found."""

    status: Status
    reason: str
    probability: float


def verify(placements: list[Placement], pairs: Pairs) -> Verdict:
    """Judges the placements, best first, at least one; `pairs` are the first one's."""
    best = placements[0]
    scores = np.array([p.score for p in placements])
    odds = np.exp(NATS * (scores - scores[0]))
    probability = float(1 / odds.sum())
    told = f"{len(pairs.surfaces)} of {len(best.explained)} wall surfaces and {len(pairs.rooms)} rooms matched"
    if best.fraction < LEAST_FRACTION or best.score < LEAST_SCORE or len(pairs.surfaces) < LEAST_SURFACES:
        return Verdict("none", f"the plan does not explain the map: at best {told}", probability)
    rivals = [p for p in placements if p.score > best.score - LEAST_MARGIN]
    if len(rivals) > 1:
        floors = list(dict.fromkeys(p.storey.floor for p in rivals))
        what = f"{len(floors)} storeys" if len(floors) == len(rivals) else f"{len(rivals)} places"
        return Verdict("ambiguous", f"{what} explain the map about equally well ({told}); see more rooms", probability)
    return Verdict("unique", f"{told}; no other place explains the map as well", probability)
