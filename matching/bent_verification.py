"""Unique, ambiguous or none: the evidence of the best hypothesis, and its margin over the runner-up."""

import numpy as np

from matching.bent import Bent
from matching.complete import Pairs
from matching.field import judge
from matching.scoring import SIGMA_SCORE
from matching.verification import (
    LEAST_EVIDENCE,
    LEAST_EVIDENCE_PER_WALL,
    LEAST_FRACTION,
    LEAST_MARGIN,
    LEAST_SURFACES,
    MARGIN_SHARE,
    PLACES_PER_M2,
    Verdict,
)  # fmt: skip


def verify(found: Bent, pairs: Pairs) -> Verdict:
    """Judges the hypotheses, best first, at least one; `pairs` are the first one's."""
    s, plan = found.scene.s, found.scene.plan
    probability = float(1 / np.exp(found.score - found.score[0]).sum())
    told = f"{len(pairs.surfaces)} of {len(s)} wall surfaces and {len(pairs.rooms)} rooms matched"
    now = judge(found.scene, found.table[:1], found.fields.state[:1], SIGMA_SCORE)
    fraction = float(s.half @ now.quality[0].max(axis=1, initial=0.0) / s.half.sum())
    if fraction < LEAST_FRACTION:
        share = f"{100 * fraction:.0f} % of its walls' length"
        return Verdict("none", f"the plan does not explain the map: {share} at the best place", probability)
    by_chance = np.log(PLACES_PER_M2 * sum(a.extent.prod() for a in plan.storeys))
    least = by_chance + LEAST_EVIDENCE + LEAST_EVIDENCE_PER_WALL * len(s)
    if found.score[0] < least or len(pairs.surfaces) < LEAST_SURFACES:
        return Verdict("none", f"too little evidence at the best place ({told}): see more rooms", probability)
    margin = LEAST_MARGIN + MARGIN_SHARE * found.score[0]
    near = np.nonzero(found.score > found.score[0] - margin)[0]
    if len(near) > 1:
        floors = [str(plan.storeys[int(found.fields.storey[k])].floor) for k in near]
        reason = f"{_what(floors)} explain the map about equally well ({told})"
        return Verdict("ambiguous", reason, probability)
    return Verdict("unique", f"{told}; no other place explains the map nearly as well", probability)


def _what(floors: list[str]) -> str:
    distinct = len(set(floors))
    if distinct == 1:
        return f"{len(floors)} places"
    return f"{distinct} storeys" if distinct == len(floors) else f"{len(floors)} places on {distinct} storeys"
