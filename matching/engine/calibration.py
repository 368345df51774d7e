"""The constants of the verdict and of all confidences, fitted by `python -m matching.training.calibrate`."""

import json
import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path

SHIPPED = Path(__file__).parents[1] / "weights" / "calibration.json"
MOST_LOG_ODDS = 50.0


@dataclass(frozen=True)
class Calibration:
    """Logistic models (J. Platt: Probabilistic outputs for support vector machines, 1999); evidence is in nats.

    `place` are the coefficients of the log odds that the map is in the plan where its best hypothesis is, or where
    another does about as well: of the evidence, of its margin over wrong places, of the number of unexplained walls,
    of the logarithm of the number of places in the plan, and a constant. The first three count up to `saturation`.
    `separation` (a, b): the log odds between two places are their difference of evidence over a + b times the number of
    unexplained walls: at another place as much may differ from the plan. `room` and `surface` (offset, slope): the log
    odds of a pair at the right place in those of its share among what stood to choose.
    """

    place: tuple[float, float, float, float, float]
    saturation: tuple[float, float, float]
    separation: tuple[float, float]
    room: tuple[float, float]
    surface: tuple[float, float]

    def log_odds(self, evidence: float, margin: float, unexplained: float, places: float) -> float:
        """The log odds that the map is in the plan; `places` is the logarithm of their number."""
        features = (*map(min, (evidence, margin, unexplained), self.saturation), places, 1.0)
        return sum(of * value for of, value in zip(self.place, features, strict=True))

    def scale(self, unexplained: float) -> float:
        """How many nats between two places are one of log odds."""
        return self.separation[0] + self.separation[1] * unexplained

    def confidence(self, share: float, of: tuple[float, float]) -> float:
        """The probability of a pair, given that the place is right; `of` is `room` or `surface`."""
        share = min(max(share, 1e-9), 1 - 1e-9)
        return probability(of[0] + of[1] * math.log(share / (1 - share)))


def probability(log_odds: float) -> float:
    """The probability of log odds."""
    return 1 / (1 + math.exp(-min(max(log_odds, -MOST_LOG_ODDS), MOST_LOG_ODDS)))


@cache
def shipped() -> Calibration:
    """The calibration that comes with the package."""
    names = Calibration.__dataclass_fields__
    stored = json.loads(SHIPPED.read_text(encoding="utf-8"))
    return Calibration(**{name: tuple(stored[name]) for name in names})
