"""Decides between unique, ambiguous and none: whether the map is in the plan at all, and whether in one place only.

A map of another building also has a best place. Its evidence grows with the plan's size, and the runner-up is close.
The constants of both probabilities, and of all confidences, are fitted by `python -m matching.training.calibrate`.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from data.geometry.se2 import Array
from matching.engine.assignment import Pairs
from matching.engine.field import judge
from matching.engine.field_loops import SIGMA_SCORE
from matching.engine.hypotheses import Hypotheses
from matching.result import Status

SURE = 0.98  # probability that the map is in the plan, and that it is in this place, of an answer that is unique
LEAST_SURFACES = 5  # of the map that have a partner: with fewer, any plan of a few walls would do
MOST_UNEXPLAINED = 0.5  # of the map's walls, by length: where more is, the plan is not the map's
PLACES_PER_M2 = 40.0  # that a vote can separate: four directions of the grid, a third of a metre
SHIPPED = Path(__file__).parents[1] / "weights" / "calibration.json"
MOST_LOG_ODDS = 50.0


@dataclass(frozen=True)
class Calibration:
    """Models of probabilities; evidence is in nats.

    `place` are the coefficients of the log odds that the map is in the plan: of log(1 + evidence / `unit`) of the best
    hypothesis, of the share of the map, by length of walls, that it leaves unexplained, of the logarithm of the
    number of places in the plan, and a constant (J. Platt: Probabilistic outputs for support vector machines, 1999).
    `separation` (a, b): hypotheses are as likely as a softmax of their evidence over a + b times the number of
    unexplained walls says: at another place as much may differ from the plan. `room` are the coefficients of the log
    odds of a room pair at the right place: of its `room_signs`, and a constant. `surface` (offset, slope): those of a
    surface pair in the log odds of its share among what stood to choose.
    """

    place: tuple[float, float, float, float]
    unit: float
    separation: tuple[float, float]
    room: tuple[float, float, float, float]
    surface: tuple[float, float]

    def in_plan(self, evidence: float, unexplained: float, places: float) -> float:
        """The probability that the map is in the plan; `places` is the logarithm of their number."""
        of, share, number, constant = self.place
        return probability(of * grown(evidence, self.unit) + share * unexplained + number * places + constant)

    def best_of(self, evidence: Sequence[float], unexplained: float) -> float:
        """The probability that the first hypothesis is the right one, if one of them is."""
        scale = self.separation[0] + self.separation[1] * unexplained
        return 1 / sum(math.exp(min((other - evidence[0]) / scale, MOST_LOG_ODDS)) for other in evidence)

    def of_rooms(self, signs: Array) -> list[float]:
        """The probabilities of room pairs with `room_signs` (R, 3), given that the place is right."""
        return [probability(x) for x in signs @ self.room[:-1] + self.room[-1]]

    def of_surface(self, share: float) -> float:
        """The probability of a surface pair, given that the place is right."""
        share = min(max(share, 1e-9), 1 - 1e-9)
        return probability(self.surface[0] + self.surface[1] * math.log(share / (1 - share)))


def grown(evidence: float, unit: float) -> float:
    """How evidence in nats counts: by its logarithm, since walls that agree are not independent."""
    return math.log1p(max(evidence, 0.0) / unit)


def probability(log_odds: float) -> float:
    """The probability of log odds."""
    return 1 / (1 + math.exp(-min(max(log_odds, -MOST_LOG_ODDS), MOST_LOG_ODDS)))


@cache
def shipped() -> Calibration:
    """The calibration that comes with the package."""
    stored = json.loads(SHIPPED.read_text(encoding="utf-8"))
    names = ("place", "separation", "room", "surface")
    return Calibration(unit=stored["unit"], **{name: tuple(stored[name]) for name in names})


@dataclass(frozen=True)
class Verdict:
    """The status with its reason; `probability` is that of the best placement."""

    status: Status
    reason: str
    probability: float


@dataclass(frozen=True)
class Signs:
    """What the verdict is based on: evidence (K,) in nats of the hypotheses, best first; the share of the map's walls,
    by length, that the first does not explain, and how many walls that is; the logarithm of the number of places in
    the plan."""

    evidence: tuple[float, ...]
    share: float
    unexplained: float
    places: float

    @staticmethod
    def of(found: Hypotheses) -> "Signs":
        """Of at least one hypothesis."""
        s, storeys = found.scene.s, found.scene.plan.storeys
        now = judge(found.scene, found.table[:1], found.fields.state[:1], SIGMA_SCORE)
        share = 1 - float(s.half @ now.quality[0].max(axis=1, initial=0.0) / s.half.sum())
        places = float(np.log(PLACES_PER_M2 * sum(a.area for a in storeys)))
        return Signs(tuple(found.score.tolist()), share, share * len(s), places)


def verify(found: Hypotheses, pairs: Pairs) -> Verdict:
    """Returns the verdict on hypotheses, best first, at least one; `pairs` are the matches of the first."""
    calibration, signs = shipped(), Signs.of(found)
    own = matched(pairs, len(found.scene.s))
    in_plan = calibration.in_plan(signs.evidence[0], signs.share, signs.places)
    best = calibration.best_of(signs.evidence, signs.unexplained)
    if signs.share > MOST_UNEXPLAINED:
        return Verdict("none", _unexplained(signs.share), in_plan * best)
    if in_plan < SURE or len(pairs.surfaces) < LEAST_SURFACES:
        reason = f"too little evidence at the best place ({own}): see more rooms"
        return Verdict("none", reason, in_plan * best)
    if best < SURE:
        near = [k for k in range(1, len(found)) if _is_near(calibration, signs, k)] or [1]
        floors = [str(found.scene.plan.storeys[int(found.fields.storey[k])].floor) for k in (0, *near)]
        reason = f"{places_named(floors)} explain the map about equally well ({own})"
        return Verdict("ambiguous", reason, in_plan * best)
    return Verdict("unique", f"{own}; no other place explains the map nearly as well", in_plan * best)


def _is_near(calibration: Calibration, signs: Signs, k: int) -> bool:
    """Whether the best hypothesis is not sure over this one."""
    return calibration.best_of((signs.evidence[0], signs.evidence[k]), signs.unexplained) < SURE


def _unexplained(share: float) -> str:
    """The reason where the plan leaves too large a share of the map unexplained."""
    return f"the plan does not explain the map: not {100 * share:.0f} % of its walls' length, at the best place"


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
