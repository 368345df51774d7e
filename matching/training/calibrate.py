"""`python -m matching.training.calibrate`: fits the verdict and all confidences to maps of known truth.

Maps are drawn from generated plans of the training split and matched by `voting`, so that neither weights nor
files are needed. Some are of another plan, and some plans lack walls. The command is
deterministic up to the last bits of floating point numbers.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize

from data.common.cli import Parser, run_command
from data.common.files import write_json
from data.geometry.se2 import Array
from data.plans.bim import Split
from data.synthetic_maps.noise_models import DrawnGraph, draw
from matching.engine.assignment import assign
from matching.engine.hypotheses import Hypotheses, scene_of, search
from matching.engine.plan_walls import PlanWalls
from matching.engine.room_signs import room_signs
from matching.engine.verdict import SHIPPED, Calibration, Signs, ranked
from matching.training.truth import KINDS, ROOMS, Surfaces, generated, right_of, seeds_of, surfaces_of, thinned

NOISE = ("real", "drift", "mis_segmented", "heavy_drift")
REGIMES = {
    "whole": 0.4,
    "foreign": 0.25,
    "thinned": 0.15,
    "partial": 0.2,
}  # shares of the maps; another plan of the same
# kind is alike in parts
FOREIGN = 0.05  # probability beforehand that the plan is of another building: users rarely mistake it
COMPARED = 100  # hypotheses of a map whose truth is looked up: a tower has many equal places
SEPARATION, START = (1.0, 0.1, 0.02), (0.0, 0.0, 0.0, 0.0)  # where fits begin
MISLABELLED = (
    0.001  # share of right hypotheses that count as wrong: their map deforms, or many of their pairs are one wall on
)
APART = 0.9  # probability of the best hypothesis among all: of such maps, those in the plan are fitted
RIDGE = 1e-4  # of the standardised coefficients


@dataclass(frozen=True)
class Answer:
    """A map of one of `REGIMES` matched: its signs, which of its first hypotheses are right, and of the first one, if
    it is right, the signs and truth of its pairs of rooms, and the shares and truth of those of surfaces."""

    regime: str
    signs: Signs
    right: tuple[bool, ...]
    rooms: tuple[tuple[list[float], bool], ...]
    surfaces: Surfaces


def main(arguments: list[str] | None = None) -> int:
    """Runs the command. Raises UserError."""
    parser = Parser(prog="python -m matching.training.calibrate", description="Fit the verdict and all confidences.")
    parser.add_argument("--maps", type=int, default=8000, help="number of maps (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the maps (default: %(default)s)")
    parser.add_argument("--out", type=Path, default=SHIPPED, metavar="FILE", help="default: the shipped file")
    options = parser.parse_args(arguments)
    answers = list(answers_on(options.maps, options.seed))
    command = f"python -m matching.training.calibrate --maps {options.maps} --seed {options.seed}"
    data = {"plans": f"generated, of the split 'train': {', '.join(KINDS)}", "noise": list(NOISE), "regimes": REGIMES}
    write_json(options.out, {"command": command, "data": data, **asdict(fit(answers))})
    print(f"wrote {options.out}")
    return 0


def answers_on(count: int, seed: int, split: Split = "train") -> Iterator[Answer]:
    """Matches maps of generated plans of a split until `count` of them have a hypothesis."""
    rng, done, seeds = np.random.default_rng(seed), 0, seeds_of(split)
    while done < count:
        kind, regime = str(rng.choice(KINDS)), str(rng.choice([*REGIMES], p=[*REGIMES.values()]))
        plan, other = (generated(kind, int(rng.choice(seeds[kind]))).graph for _ in range(2))
        rooms = ROOMS[int(rng.integers(len(ROOMS)))]
        drawn = draw(other if regime == "foreign" else plan, str(rng.choice(NOISE)), rng, rooms)
        walls = PlanWalls.of(thinned(plan, rng) if regime == "thinned" else plan)
        if (regime == "foreign" and other is plan) or walls is None:
            continue
        found = search(scene_of(drawn.s_graph, walls))
        if len(found):
            done += 1
            yield _answer(*ranked(found), drawn, regime)


def _answer(found: Hypotheses, signs: Signs, truth: DrawnGraph, regime: str) -> Answer:
    if regime == "foreign":
        return Answer(regime, signs, (False,) * len(found), (), ())
    pairs = [assign(found, k) for k in range(min(len(found), COMPARED))]
    surfaces = [surfaces_of(found, k, pairs[k], truth) for k in range(len(pairs))]
    right = right_of(found, truth, surfaces)
    if not right[0] or regime != "whole":
        return Answer(regime, signs, right, (), ())
    s, a = found.scene.s, found.scene.plan.storeys[int(found.fields.storey[0])]
    true = [truth.rooms.get(s.rooms[r].id) == a.rooms[q].id for r, q, _ in pairs[0].rooms]
    of_rooms = room_signs(found, pairs[0].rooms).tolist()
    return Answer(regime, signs, right, tuple(zip(of_rooms, true, strict=True)), surfaces[0])


def fit(answers: Sequence[Answer]) -> Calibration:
    """Fits all models by maximum likelihood."""
    found = [a for a in answers if any(a.right)]

    def loss(scale: Array) -> float:
        known = np.exp([-_surprise(a, np.exp(scale)) for a in found])
        return -float(np.mean(np.log((1 - MISLABELLED) * known + MISLABELLED)))

    separation = _rounded(np.exp(minimize(loss, np.log(SEPARATION), method="Nelder-Mead").x))
    begun = Calibration(START, separation, START, START[:2])
    apart = [a for a in answers if begun.among(a.signs)[0] > APART]
    foreign = np.array([a.regime == "foreign" for a in answers])
    weight = {True: FOREIGN / foreign.mean(), False: (1 - FOREIGN) / (1 - foreign.mean())}
    weights = np.array([weight[a.regime == "foreign"] for a in apart])
    place = logistic(np.array([a.signs.features for a in apart]), np.array([a.right[0] for a in apart]), weights)
    rooms = [pair for a in answers for pair in a.rooms]
    room = logistic(np.array([signs for signs, _ in rooms]), np.array([true for _, true in rooms]))
    surface = _of_shares([pair for a in answers for pair in a.surfaces])
    return Calibration(_rounded(place), separation, _rounded(room), _rounded(surface))


def _surprise(answer: Answer, separation: Array) -> float:
    """Minus the logarithm of the probability of the right hypotheses."""
    scale = Calibration(START, tuple(separation.tolist()), START, START[:2]).temperature(answer.signs)
    evidence = answer.signs.evidence[: len(answer.right)] / scale
    return float(np.logaddexp.reduce(evidence) - np.logaddexp.reduce(evidence[np.array(answer.right)]))


def _rounded(of: Array) -> Any:
    return tuple(round(float(x), 4) for x in of)


def _of_shares(pairs: Sequence[tuple[float, bool]]) -> Array:
    """(2,) offset and slope of the log odds in those of the share."""
    share, true = np.clip([c for c, _ in pairs], 1e-9, 1 - 1e-9), np.array([t for _, t in pairs])
    return logistic(np.log(share / (1 - share))[:, None], true)[::-1]


def logistic(features: Array, true: Array, weights: Array | float = 1.0) -> Array:
    """(features + 1,) coefficients and constant of a logistic regression with a ridge, on (N, features) with (N,)
    weights."""
    mean, deviation = features.mean(axis=0), features.std(axis=0)
    columns = np.column_stack(((features - mean) / deviation, np.ones(len(features))))

    def loss(weight: Array) -> float:
        log_odds = columns @ weight
        surprise = float(np.mean(weights * (np.logaddexp(0, log_odds) - true * log_odds)))
        return surprise + RIDGE * float(weight[:-1] @ weight[:-1])

    weight = minimize(loss, np.zeros(columns.shape[1])).x
    slope = weight[:-1] / deviation
    return np.append(slope, weight[-1] - slope @ mean)


if __name__ == "__main__":
    run_command(main)
