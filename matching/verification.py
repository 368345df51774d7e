"""Unique, ambiguous or none: the evidence of the best placement, and its margin over the runner-up."""

from dataclasses import dataclass

import numpy as np

from matching.complete import Pairs
from matching.hypotheses import Placement
from matching.result import Status
from matching.walls import Walls

LEAST_SURFACES = 5
LEAST_FRACTION = 0.55  # of the map that the plan explains
LEAST_EVIDENCE = 8.0  # nats above what the best of all places reaches by chance
LEAST_EVIDENCE_PER_WALL = 0.4
LEAST_MARGIN = 4.0  # nats over the runner-up,
MARGIN_SHARE = 0.12  # and of the evidence: two nearly equal places differ by the same noise everywhere


@dataclass(frozen=True)
class Verdict:
    """`probability` is that of the best placement among those found."""

    status: Status
    reason: str
    probability: float


def verify(placements: list[Placement], storeys: list[Walls], pairs: Pairs) -> Verdict:
    """Judges the placements, best first, at least one; `pairs` are the first one's."""
    best = placements[0]
    scores = np.array([p.score for p in placements])
    probability = float(1 / np.exp(scores - scores[0]).sum())
    told = (
        f"{len(pairs.surfaces)} of {len(best.explained)} wall surfaces and {len(pairs.rooms)} rooms matched"
    )
    chance = np.log(sum(float(np.prod(np.ptp(a.centre, axis=0) + 1.0)) for a in storeys) * 4 / 0.1)
    if (
        best.fraction < LEAST_FRACTION
        or best.score - chance < max(LEAST_EVIDENCE, LEAST_EVIDENCE_PER_WALL * len(best.explained))
        or len(pairs.surfaces) < LEAST_SURFACES
    ):
        return Verdict("none", f"the plan does not explain the map: at best {told}", probability)
    margin = LEAST_MARGIN + MARGIN_SHARE * best.score
    rivals = [p for p in placements if p.score > best.score - margin]
    if len(rivals) > 1:
        floors = list(dict.fromkeys(p.storey.floor for p in rivals))
        what = f"{len(floors)} storeys" if len(floors) == len(rivals) else f"{len(rivals)} places"
        return Verdict("ambiguous", f"{what} explain the map about equally well ({told}); see more rooms", probability)
    return Verdict("unique", f"{told}; no other place explains the map as well", probability)
