"""Decides between unique, ambiguous and none: the posterior of each place, and of being in none of them.

A map of another building also has a best place. Its evidence grows with the plan's size, and the runner-up is close.
What differs from the plan differs at all places, so differences of evidence count less the more evidence there is.
The constants of all probabilities are fitted by `python -m matching.training.calibrate`.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from data.geometry.se2 import Array
from matching.arrays import Index
from matching.engine.assignment import Pairs
from matching.engine.field import judge
from matching.engine.field_loops import SIGMA_SCORE
from matching.engine.free_space import conflicts
from matching.engine.hypotheses import Hypotheses
from matching.result import START_M, Status

LEAST_SURFACES = 5  # of the map that have a partner: with fewer, any plan of a few walls would do
SURE = 0.98  # probability of the best place of an answer that is unique
PLACES_PER_M2 = 40.0  # that a vote can separate: four directions of the grid, a third of a metre
SHIPPED = Path(__file__).parents[1] / "weights" / "calibration.json"
MOST_LOG_ODDS = 50.0
USUAL_CONFLICT_M = 0.5  # metres, at the right place: outlines of rooms are coarse; none in 98.5 % of maps by SLAM
NOT_BUILT = 0.05  # prior that a planned wall that the map should show was not built, or is a door


@dataclass(frozen=True)
class Calibration:
    """Models of probabilities; evidence is in nats.

    `place` are the coefficients of the log odds that the map is in the plan, of `Signs.features`, and a constant (J.
    Platt: Probabilistic outputs for support vector machines, 1999).
    `separation` (a, b, c): hypotheses are as likely as a softmax of their evidence over a + b times the number of
    unexplained walls + c times the evidence of the best says: at another place as much may differ from the plan.
    `room` are the coefficients of the log odds of a room pair at the right place: of its `room_signs`, and a constant.
    `surface` (offset, slope): those of a surface pair in the log odds of its share among what stood to choose.
    """

    place: tuple[float, float, float, float]
    separation: tuple[float, float, float]
    room: tuple[float, float, float, float]
    surface: tuple[float, float]

    def probabilities(self, signs: "Signs") -> Array:
        """(K,) the probability of each hypothesis; what lacks to 1 is that of none."""
        among = self.among(signs)
        return self.in_plan(signs[np.array([among.argmax()])]) * among

    def in_plan(self, signs: "Signs") -> float:
        """The probability that the map is in the plan, by the first hypothesis."""
        of = np.array([*signs.features, 1.0])
        return probability(float(of @ np.array(self.place)))

    def temperature(self, signs: "Signs", is_mirrored: bool = False) -> float:
        """The nats of evidence that make one hypothesis e times as likely as another, or as one of the mirror image,
        which explains the same walls."""
        a, b, c = self.separation
        return a + b * signs.unexplained + (0.0 if is_mirrored else c * max(signs.evidence.max(), 0.0))

    def among(self, signs: "Signs") -> Array:
        """(K,) the probability of each hypothesis, if one of them is right."""
        nats = signs.evidence / self.temperature(signs) + signs.of_free_space
        likely = np.exp(np.maximum(nats - nats.max(), -MOST_LOG_ODDS))
        return np.asarray(likely / likely.sum())

    def of_rooms(self, signs: Array) -> list[float]:
        """The probabilities of room pairs with `room_signs` (R, 3), given that the place is right."""
        return [probability(x) for x in signs @ self.room[:-1] + self.room[-1]]

    def of_surface(self, share: float) -> float:
        """The probability of a surface pair, given that the place is right."""
        share = min(max(share, 1e-9), 1 - 1e-9)
        return probability(self.surface[0] + self.surface[1] * math.log(share / (1 - share)))


def probability(log_odds: float) -> float:
    """The probability of log odds."""
    return 1 / (1 + math.exp(-min(max(log_odds, -MOST_LOG_ODDS), MOST_LOG_ODDS)))


@cache
def shipped() -> Calibration:
    """The calibration that comes with the package."""
    stored = json.loads(SHIPPED.read_text(encoding="utf-8"))
    return Calibration(**{name: tuple(stored[name]) for name in ("place", "separation", "room", "surface")})


@dataclass(frozen=True)
class Verdict:
    """The status with its reason; the probability (K,) of each hypothesis, what lacks to 1 is that of none; and the
    `temperature` of `MatchResult`."""

    status: Status
    reason: str
    probabilities: tuple[float, ...]
    temperature: float


@dataclass(frozen=True)
class Signs:
    """What the verdict is based on: evidence (K,) in nats; how many of the map's walls the hypothesis of most evidence
    does not explain; the logarithms of the numbers of the map's walls and of places in the plan; metres (K,) of planned
    walls in the map's free space."""

    evidence: Array
    unexplained: float
    walls: float
    places: float
    conflict: Array

    def __getitem__(self, chosen: Index) -> "Signs":
        """Those of some hypotheses."""
        return replace(self, evidence=self.evidence[chosen], conflict=self.conflict[chosen])

    @property
    def of_free_space(self) -> Array:
        """(K,) the log likelihood ratios of the conflicts: at the right place there are few, unless walls were not
        built. Rays see free space, points see walls, so that this is not divided by the temperature."""
        return np.log(NOT_BUILT + (1 - NOT_BUILT) * np.exp(-self.conflict / USUAL_CONFLICT_M))

    @property
    def features(self) -> tuple[float, float, float]:
        """Those of `Calibration.place`, for the first hypothesis."""
        return max(float(self.evidence[0]), 0.0) / math.exp(self.walls), self.walls, self.places

    @staticmethod
    def of(found: Hypotheses, near_start: bool = False) -> "Signs":
        """Of at least one hypothesis; all are `near_start`, if one was given."""
        s, storeys, best = found.scene.s, found.scene.plan.storeys, found[np.array([found.score.argmax()])]
        now = judge(best.scene, best.table, best.fields.state, SIGMA_SCORE)
        share = 1 - float(s.half @ now.quality[0].max(axis=1, initial=0.0) / s.half.sum())
        area = sum(a.area for a in storeys)
        places = float(np.log(PLACES_PER_M2 * (min(area, np.pi * START_M**2) if near_start else area)))
        return Signs(found.score, share * len(s), float(np.log(len(s))), places, conflicts(found))


def ranked(found: Hypotheses, near_start: bool = False) -> tuple[Hypotheses, Signs]:
    """Hypotheses, the likeliest first, and their signs; at least one."""
    signs = Signs.of(found, near_start)
    order = np.argsort(-shipped().among(signs), kind="stable")
    return found[order], signs[order]


def verify(found: Hypotheses, pairs: Pairs, likely: Array, temperature: float) -> Verdict:
    """Returns the verdict on hypotheses, the likeliest first, at least one, with their probabilities (K,); `pairs` are
    the matches of the first."""
    own = matched(pairs, len(found.scene.s))
    likely = likely if len(pairs.surfaces) >= LEAST_SURFACES else 0.0 * likely
    in_plan, probabilities = float(likely.sum()), tuple(likely.tolist())
    if probabilities[0] >= SURE:
        return Verdict("unique", f"{own}; no other place explains the map nearly as well", probabilities, temperature)
    if in_plan < SURE:
        reason = f"too little evidence at the best place ({own}): see more rooms"
        return Verdict("none", reason, probabilities, temperature)
    near = [k for k in range(1, len(found)) if likely[0] < SURE / (1 - SURE) * likely[k]] or [1]
    floors = [str(found.scene.plan.storeys[int(found.fields.storey[k])].floor) for k in (0, *near)]
    reason = f"{places_named(floors)} explain the map about equally well ({own})"
    return Verdict("ambiguous", reason, probabilities, temperature)


def matched(pairs: Pairs, walls: int) -> str:
    """How many of the map's `walls` have a match, and how many of the plan's rooms."""
    rooms = len({pair[1] for pair in pairs.rooms})
    return f"{len(pairs.surfaces)} of {walls} wall surfaces and {rooms} {'room' if rooms == 1 else 'rooms'} matched"


def places_named(floors: Sequence[str]) -> str:
    """Places, each on one of `floors`: how many, and on how many storeys."""
    distinct = len(set(floors))
    if distinct == 1:
        return f"{len(floors)} places"
    return f"{distinct} storeys" if distinct == len(floors) else f"{len(floors)} places on {distinct} storeys"
