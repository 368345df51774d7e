"""`python -m matching.training.calibrate`: fits the verdict and all confidences to maps of known truth.

Maps are drawn from generated plans of the training split and matched by the proposals of `voting`, so that neither
weights nor files are needed; some are of another plan. The command is deterministic up to the last bits of floating
point numbers.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from data.common.cli import Parser, run_command
from data.common.files import write_json
from data.geometry.se2 import Array
from data.synthetic_maps.noise_models import DrawnGraph, draw
from matching.arrays import PlanCache
from matching.engine.assignment import Pairs, assign
from matching.engine.hypotheses import Hypotheses, scene_of, search
from matching.engine.plan_walls import PlanWalls
from matching.engine.room_signs import room_signs
from matching.engine.verdict import SHIPPED, Calibration, Signs, grown
from matching.training.data import generated, seeds_of

KINDS = ("apartment", "office", "corridor", "l_shape", "skewed", "mirrored_twins", "tower")
NOISE = ("real", "drift", "mis_segmented", "heavy_drift")
ROOMS = (1, 2, 3, 4, 6, 9, None)
SEEDS = 90  # of generated plans of each kind
FOREIGN = 0.4  # share of maps of another plan of the same kind, which is alike in parts
RIGHT = 0.8  # of a hypothesis' wall pairs, by number, that are true
COMPARED = 100  # hypotheses of a map whose truth is looked up: a tower has many equal places
UNIT = 10.0  # nats
SEPARATION, START = (1.0, 0.1), (0.0, 0.0, 0.0, 0.0)  # where fits begin
APART = 0.9  # probability of the best hypothesis among all: of such maps, those in the plan are fitted
RIDGE = 1e-4  # of the standardised coefficients


@dataclass(frozen=True)
class Answer:
    """A map matched: its signs, which of its first hypotheses are right, and of the first one, if it is right, the
    signs and truth of its pairs of rooms, and the shares and truth of those of surfaces."""

    signs: Signs
    right: tuple[bool, ...]
    rooms: tuple[tuple[list[float], bool], ...]
    surfaces: tuple[tuple[float, bool], ...]


def main(arguments: list[str] | None = None) -> int:
    """Runs the command. Raises UserError."""
    parser = Parser(prog="python -m matching.training.calibrate", description="Fit the verdict and all confidences.")
    parser.add_argument("--maps", type=int, default=6000, help="number of maps (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0, help="of the maps (default: %(default)s)")
    parser.add_argument("--out", type=Path, default=SHIPPED, metavar="FILE", help="default: the shipped file")
    options = parser.parse_args(arguments)
    answers = list(answers_on(options.maps, options.seed))
    command = f"python -m matching.training.calibrate --maps {options.maps} --seed {options.seed}"
    data = {"plans": f"generated, of the split 'train': {', '.join(KINDS)}", "noise": list(NOISE), "maps": len(answers)}
    write_json(options.out, {"command": command, "data": data, **asdict(fit(answers))})
    print(f"wrote {options.out}")
    return 0


def answers_on(count: int, seed: int) -> Iterator[Answer]:
    """Matches maps of generated plans until `count` of them have a hypothesis."""
    rng, done, arrays_of, seeds = np.random.default_rng(seed), 0, PlanCache(PlanWalls.of), seeds_of("train", SEEDS)
    while done < count:
        kind = str(rng.choice(KINDS))
        plan, other = (generated(kind, int(rng.choice(seeds[kind]))).graph for _ in range(2))
        foreign = rng.random() < FOREIGN
        rooms = ROOMS[int(rng.integers(len(ROOMS)))]
        drawn = draw(other if foreign else plan, str(rng.choice(NOISE)), rng, rooms)
        if foreign and other is plan:
            continue
        walls = arrays_of(plan)
        assert walls is not None
        scene = scene_of(drawn.s_graph, walls)
        found = search(scene)
        if len(found):
            done += 1
            yield _answer(found, replace(drawn, rooms={}, wall_surfaces={}) if foreign else drawn)


def _answer(found: Hypotheses, truth: DrawnGraph) -> Answer:
    pairs = [assign(found, k) for k in range(min(len(found), COMPARED))]
    told = [_surfaces(found, k, pairs[k], truth) for k in range(len(pairs))]
    right = tuple(sum(true for _, true in walls) > RIGHT * len(walls) for walls in told)
    if not right[0]:
        return Answer(Signs.of(found), right, (), ())
    s, a = found.scene.s, found.scene.plan.storeys[int(found.fields.storey[0])]
    true = [truth.rooms.get(s.rooms[r].id) == a.rooms[q].id for r, q, _ in pairs[0].rooms]
    signs = room_signs(found, pairs[0].rooms).tolist()
    return Answer(Signs.of(found), right, tuple(zip(signs, true, strict=True)), told[0])


def _surfaces(found: Hypotheses, k: int, pairs: Pairs, truth: DrawnGraph) -> tuple[tuple[float, bool], ...]:
    """The shares of a hypothesis' pairs of surfaces, and whether they are true."""
    s, a = found.scene.s, found.scene.plan.storeys[int(found.fields.storey[k])]
    return tuple((c, truth.wall_surfaces.get(s.ids[i]) == a.ids[j]) for i, j, c in pairs.surfaces)


def fit(answers: Sequence[Answer]) -> Calibration:
    """Fits all models by maximum likelihood."""
    found = [a for a in answers if any(a.right)]

    def loss(scale: Array) -> float:
        return float(np.mean([_surprise(a, *np.exp(scale)) for a in found]))

    separation = np.exp(minimize(loss, np.log(SEPARATION), method="Nelder-Mead").x)
    begun = Calibration(START, UNIT, (float(separation[0]), float(separation[1])), START, START[:2])
    apart = [a for a in answers if begun.best_of(a.signs.evidence, a.signs.unexplained) > APART]
    signs = [(grown(a.signs.evidence[0], UNIT), a.signs.share, a.signs.places) for a in apart]
    place = _logistic(np.array(signs), np.array([a.right[0] for a in apart]))
    rooms = [pair for a in answers for pair in a.rooms]
    room = _logistic(np.array([signs for signs, _ in rooms]), np.array([true for _, true in rooms]))
    surface = _of_shares([pair for a in answers for pair in a.surfaces])
    rounded = [tuple(round(float(x), 4) for x in of) for of in (place, separation, room, surface)]
    return Calibration(rounded[0], UNIT, *rounded[1:])  # type: ignore[arg-type]


def _surprise(answer: Answer, a: float, b: float) -> float:
    """Minus the logarithm of the probability of the right hypotheses."""
    evidence = np.array(answer.signs.evidence[: len(answer.right)]) / (a + b * answer.signs.unexplained)
    return float(np.logaddexp.reduce(evidence) - np.logaddexp.reduce(evidence[np.array(answer.right)]))


def _of_shares(pairs: Sequence[tuple[float, bool]]) -> Array:
    """(2,) offset and slope of the log odds in those of the share."""
    share, true = np.clip([c for c, _ in pairs], 1e-9, 1 - 1e-9), np.array([t for _, t in pairs])
    return _logistic(np.log(share / (1 - share))[:, None], true)[::-1]


def _logistic(features: Array, true: Array) -> Array:
    """(features + 1,) coefficients and constant of a logistic regression with a ridge, on (N, features)."""
    mean, deviation = features.mean(axis=0), features.std(axis=0)
    columns = np.column_stack(((features - mean) / deviation, np.ones(len(features))))

    def loss(weight: Array) -> float:
        log_odds = columns @ weight
        surprise = float(np.mean(np.logaddexp(0, log_odds) - true * log_odds))
        return surprise + RIDGE * float(weight[:-1] @ weight[:-1])

    weight = minimize(loss, np.zeros(columns.shape[1])).x
    slope = weight[:-1] / deviation
    return np.append(slope, weight[-1] - slope @ mean)


if __name__ == "__main__":
    run_command(main)
