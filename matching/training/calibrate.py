"""`python -m matching.training.calibrate`: fits the verdict and all confidences to maps of known truth.

Maps are drawn from generated plans of the training split and matched by the proposals of `voting`, so that neither
weights nor files are needed. Some are of another plan, and some plans lack walls. The command is
deterministic up to the last bits of floating point numbers.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize

from data.common.cli import Parser, run_command
from data.common.files import write_json
from data.geometry import se2
from data.geometry.se2 import Array
from data.scene_graph import SceneGraph
from data.synthetic_maps.noise_models import DrawnGraph, draw
from matching.engine.assignment import Pairs, assign
from matching.engine.hypotheses import Hypotheses, scene_of, search
from matching.engine.plan_walls import PlanWalls
from matching.engine.room_signs import room_signs
from matching.engine.verdict import SHIPPED, Calibration, Signs
from matching.training.data import Split, generated, seeds_of

KINDS = ("apartment", "office", "corridor", "l_shape", "skewed", "mirrored_twins", "tower")
NOISE = ("real", "drift", "mis_segmented", "heavy_drift")
ROOMS = (1, 2, 3, 4, 6, 9, None)
SEEDS = 90  # of generated plans of each kind
REGIMES = {
    "whole": 0.4,
    "foreign": 0.25,
    "thinned": 0.15,
    "partial": 0.2,
}  # shares of the maps; another plan of the same
# kind is alike in parts
THINNED = 0.2, 0.6  # shares of the walls that a plan lacks
FOREIGN = 0.05  # probability beforehand that the plan is of another building: users rarely mistake it
RIGHT = 0.8  # of a hypothesis' wall pairs, by number, that are true, or
RIGHT_M, RIGHT_RAD = 1.0, float(np.radians(5))  # how near it is to the true place
COMPARED = 100  # hypotheses of a map whose truth is looked up: a tower has many equal places
SEPARATION, START = (1.0, 0.1, 0.02), (0.0, 0.0, 0.0, 0.0)  # where fits begin
MISLABELLED = (
    0.001  # share of right hypotheses that count as wrong: their map deforms, or many of their pairs are one wall on
)
APART = 0.9  # probability of the best hypothesis among all: of such maps, those in the plan are fitted
RIDGE = 1e-4  # of the standardised coefficients
Surfaces = tuple[tuple[float, bool], ...]  # shares of a hypothesis' pairs of surfaces, and whether they are true


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
    rng, done, seeds = np.random.default_rng(seed), 0, seeds_of(split, SEEDS)
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
            yield _answer(found, drawn, regime)


def thinned(plan: SceneGraph, rng: np.random.Generator) -> SceneGraph:
    """The plan without some of its walls."""
    kept = rng.random(len(plan.wall_surfaces)) >= rng.uniform(*THINNED)
    return replace(plan, wall_surfaces=tuple(w for w, keep in zip(plan.wall_surfaces, kept, strict=True) if keep))


def _answer(found: Hypotheses, truth: DrawnGraph, regime: str) -> Answer:
    if regime == "foreign":
        return Answer(regime, Signs.of(found), (False,) * len(found), (), ())
    pairs = [assign(found, k) for k in range(min(len(found), COMPARED))]
    surfaces = [surfaces_of(found, k, pairs[k], truth) for k in range(len(pairs))]
    right = right_of(found, truth, surfaces)
    if not right[0] or regime != "whole":
        return Answer(regime, Signs.of(found), right, (), ())
    s, a = found.scene.s, found.scene.plan.storeys[int(found.fields.storey[0])]
    true = [truth.rooms.get(s.rooms[r].id) == a.rooms[q].id for r, q, _ in pairs[0].rooms]
    signs = room_signs(found, pairs[0].rooms).tolist()
    return Answer(regime, Signs.of(found), right, tuple(zip(signs, true, strict=True)), surfaces[0])


def right_of(found: Hypotheses, truth: DrawnGraph, surfaces: Sequence[Surfaces]) -> tuple[bool, ...]:
    """Whether each hypothesis with these pairs is right: of a map that deforms many walls may be a neighbour's."""
    near = is_near(found, truth.s_graph, np.array(truth.T_a_s), truth.floor)
    return tuple(
        near[k] or (len(walls) > 0 and sum(true for _, true in walls) > RIGHT * len(walls))
        for k, walls in enumerate(surfaces)
    )


def is_near(found: Hypotheses, s: SceneGraph, true: Array, floor: str | None) -> list[bool]:
    """Whether each hypothesis is near the true place (3,) of a map."""
    middle = np.array(s.centroid())
    off = np.linalg.norm(se2.apply(found.between_graphs, middle) - se2.apply(true, middle), axis=-1)
    turn = np.abs(se2.wrap(found.between_graphs[:, 0] - true[0]))
    floors = [floor in (None, found.scene.plan.storeys[int(k)].floor) for k in found.fields.storey]
    return [bool(near) for near in (off < RIGHT_M) & (turn < RIGHT_RAD) & np.array(floors)]


def surfaces_of(found: Hypotheses, k: int, pairs: Pairs, truth: DrawnGraph) -> Surfaces:
    """The shares of a hypothesis' pairs of surfaces, and whether they are true."""
    s, a = found.scene.s, found.scene.plan.storeys[int(found.fields.storey[k])]
    return tuple((c, truth.wall_surfaces.get(s.ids[i]) == a.ids[j]) for i, j, c in pairs.surfaces)


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
    evidence = np.array(answer.signs.evidence[: len(answer.right)]) / scale
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
