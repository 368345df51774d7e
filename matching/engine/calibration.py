"""The constants of the verdict and of all confidences, fitted by `python -m matching.training.calibrate`."""

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

SHIPPED = Path(__file__).parents[1] / "weights" / "calibration.json"
MOST_LOG_ODDS = 50.0


@dataclass(frozen=True)
class Calibration:
    """Models of probabilities; evidence is in nats.

    `place` are the coefficients of the log odds that the map is in the plan: of log(1 + evidence / `unit`) of the best
    hypothesis, of the share of the map, by length of walls, that it leaves unexplained, of the logarithm of the
    number of places in the plan, and a constant (J. Platt: Probabilistic outputs for support vector machines, 1999).
    `separation` (a, b): hypotheses are as likely as a softmax of their evidence over a + b times the number of
    unexplained walls says: at another place as much may differ from the plan. `room` and `surface` (offset, slope): the
    log odds of a pair at the right place in those of its share among what stood to choose.
    """

    place: tuple[float, float, float, float]
    unit: float
    separation: tuple[float, float]
    room: tuple[float, float]
    surface: tuple[float, float]

    def in_plan(self, evidence: float, unexplained: float, places: float) -> float:
        """The probability that the map is in the plan; `places` is the logarithm of their number."""
        of, share, number, constant = self.place
        return probability(of * grown(evidence, self.unit) + share * unexplained + number * places + constant)

    def best_of(self, evidence: Sequence[float], unexplained: float) -> float:
        """The probability that the first hypothesis is the right one, if one of them is."""
        scale = self.separation[0] + self.separation[1] * unexplained
        return 1 / sum(math.exp(min((other - evidence[0]) / scale, MOST_LOG_ODDS)) for other in evidence)

    def confidence(self, share: float, of: tuple[float, float]) -> float:
        """The probability of a pair, given that the place is right; `of` is `room` or `surface`."""
        share = min(max(share, 1e-9), 1 - 1e-9)
        return probability(of[0] + of[1] * math.log(share / (1 - share)))


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
