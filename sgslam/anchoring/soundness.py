"""Whether a placed map is sound: the log likelihood ratios of its signals, and the probability that follows.

A map that is warped, or two places mapped as one, may still fit a plan. Then its poses are less certain, the plan is
tilted in it, it differs from the odometry, or the sensor's path leads through walls. Each signal has a noise model for
sound and for unsound maps; the signals are not independent, so their sum counts by a share. All numbers are fitted by
`python -m evaluation.calibration`.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

FILE = Path(__file__).with_name("calibration.json")
LAPLACE = ("plan_tilt_deg", "map_against_odometry", "position_sigma_m", "walls_looked_through")  # of their logarithms
CROSSED = "planned_walls_crossed"  # a count
LEAST = 1e-4  # of a signal, smaller ones count as this
Model = tuple[float, float]


@dataclass(frozen=True)
class Soundness:
    """The probability that a map is sound, and the `nats` of each signal in favour of it."""

    probability: float
    nats: Mapping[str, float]


@dataclass(frozen=True)
class SoundnessModel:
    """`sound` and `unsound` give, for each signal, the median and the mean deviation of its logarithm (a Laplace
    distribution), or for the count of crossed walls the ratio of successive probabilities (a geometric one), twice.

    `prior` are the log odds that a map is sound, `share` what the sum of the nats counts.
    """

    sound: Mapping[str, Model]
    unsound: Mapping[str, Model]
    prior: float
    share: float

    def judged(self, signals: Mapping[str, float]) -> Soundness:
        """The soundness by the signals that are known."""
        nats = {name: self.nats(name, value) for name, value in signals.items() if name in self.sound}
        log_odds = self.prior + self.share * sum(nats.values())
        return Soundness(1 / (1 + math.exp(-max(min(log_odds, 50.0), -50.0))), nats)

    def nats(self, name: str, value: float) -> float:
        """The log likelihood ratio of one signal."""
        return _log_density(name, value, self.sound[name]) - _log_density(name, value, self.unsound[name])


def _log_density(name: str, value: float, model: Model) -> float:
    if name == CROSSED:
        return math.log(1 - model[0]) + value * math.log(model[0])
    return -abs(math.log(max(value, LEAST)) - model[0]) / model[1] - math.log(2 * model[1])


@cache
def known_map() -> tuple[float, ...]:
    """The model of `in_known_map` that comes with the package."""
    return tuple(json.loads(FILE.read_text(encoding="utf-8"))["known_map"])


@cache
def shipped() -> SoundnessModel:
    """The model that comes with the package."""
    stored = json.loads(FILE.read_text(encoding="utf-8"))
    sound, unsound = ({name: tuple(of) for name, of in stored[kind].items()} for kind in ("sound", "unsound"))
    return SoundnessModel(sound, unsound, stored["prior"], stored["share"])
