"""What the combinatorial search is asked, with what its public code answered or the seconds that it took."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Generic, Literal, NamedTuple, TypeVar, get_args

import numpy as np

from data import SceneGraph, WallSurface
from evaluation.published.combinatorial_layouts import Noise, grid, polygons, seen, subset
from matching.result import MatchResult

T = TypeVar("T")
Version = Literal["released", "later branch"]
VERSIONS: tuple[Version, ...] = get_args(Version)  # of the public code
Pairs = Sequence[tuple[SceneGraph, SceneGraph]]
L_SHAPE = (0, 1, 5)  # rooms of the plan of 8 without a mirror or rotational symmetry
SEEDS = 10
SHAPES = {2: (2, 1), 4: (2, 2), 8: (4, 2), 12: (4, 3)}
LATE_S = 300.0  # time limit of the public code's measurement; 120 s for many walls
GIVEN_UP = (LATE_S, 120.0)
HEAVY = ("12:6", "12:12", "2:2, 8 walls a room")  # layouts where a version needs a minute

TWINS: Sequence[tuple[int, int, tuple[str, str]]] = (
    (2, 2, ("4 tie", "unique, right")), (4, 2, ("16 tie", "ambiguous")), (4, 3, ("8 tie", "unique, right")),
    (4, 4, ("more than 1 tie", "unique, right")),
)  # fmt: skip
NOISES: Sequence[tuple[Noise, tuple[str, str]]] = (
    (Noise(0.03, 0.5), ("10 unique and perfect", "")), (Noise(0.06, 1.0), ("9 unique and perfect", "7")),
    (Noise(0.10, 1.5), ("5 unique and perfect", "1")),
)  # fmt: skip
GRIDS: Sequence[tuple[int, int, tuple[float | None, float | None]]] = (
    (2, 2, (0.18, 0.31)), (4, 2, (0.28, 0.38)), (4, 3, (0.71, 0.79)), (4, 4, (3.9, 2.5)), (8, 2, (0.32, 1.3)),
    (8, 3, (0.88, 2.0)), (8, 4, (3.7, 4.8)), (8, 5, (16.9, 37.0)), (8, 6, (98.9, 135.0)), (8, 8, (LATE_S, LATE_S)),
    (12, 2, (0.16, 1.1)), (12, 3, (0.74, 3.1)), (12, 4, (6.8, 57.7)), (12, 5, (86.0, LATE_S)),
    (12, 6, (LATE_S, None)), (12, 12, (None, None)),
)  # fmt: skip
WALLS = ((4, 0.24), (5, 0.63), (6, 2.9), (7, 25.8), (8, 120.0))
SQUARES = ((3, 10.5), (4, 89.0))


class Question(NamedTuple, Generic[T]):
    """Pairs of an S-graph and an A-graph; what was measured on the `VERSIONS` of the public code."""

    pairs: Pairs
    public: tuple[T, T]


def questions() -> dict[str, Question[str]]:
    """The questions, by name, with the answers of the public code."""
    plan = grid(4, 2)
    s = seen(plan, L_SHAPE)
    spurious = WallSurface("spurious", s.rooms[0].id, s.rooms[0].centroid, (1.0, 0.0), 1.0)
    one_more, one_less = (replace(s, wall_surfaces=w) for w in ((*s.wall_surfaces, spurious), s.wall_surfaces[1:]))
    found = {f"twins: equal squares, {a}:{n}": Question(_squares(a, n), public) for a, n, public in TWINS}
    found |= {
        "as built, 8:3": Question([(s, plan)], ("unique, right", "unique, right")),
        "the building mirrored": Question([(seen(plan, L_SHAPE, mirrored=True), plan)], ("unique", "none")),
        "S turned by 90°": Question([(seen(plan, L_SHAPE, turned=np.pi / 2), plan)], ("as not turned", "none")),
        "one spurious 5th wall in a room": Question([(one_more, plan)], ("none", "none")),
        "one wall missing": Question([(one_less, plan)], ("unique", "unique")),
        "more rooms in S than in A": Question([(s, grid(2, 1))], ("none", "none")),
        "one room in S": Question([(seen(plan, (0,)), plan)], ("4 tie, 5 pairs each", "1 answer")),
        "S empty": Question([(SceneGraph("map"), plan)], ("raises IndexError", "")),
    }
    for noise, public in NOISES:
        plans = [grid(4, 2, seed=seed) for seed in range(SEEDS)]
        pairs = [(seen(own, subset(own, 3, seed), seed, noise), own) for seed, own in enumerate(plans)]
        name = f"noise {100 * noise.metres:g} cm, {noise.degrees:g}°, 8:3, {SEEDS} buildings"
        found[name] = Question(pairs, public)
    return found


def layouts() -> dict[str, Question[float | None]]:
    """The layouts, by name, with the seconds of the public code (None: not measured): uneven rooms A:S rooms, rooms
    with many walls, equal squares."""
    found: dict[str, Question[float | None]] = {}
    for a, s, public in GRIDS:
        plan = grid(*SHAPES[a])
        found[f"{a}:{s}"] = Question([(seen(plan, subset(plan, s)), plan)], public)
    for walls, seconds in WALLS:
        plan = polygons(2, walls)
        found[f"2:2, {walls} walls a room"] = Question([(seen(plan, (0, 1)), plan)], (seconds, None))
    return found | {f"4:{s}, equal squares": Question(_squares(4, s), (seconds, None)) for s, seconds in SQUARES}


def _squares(a: int, s: int) -> Pairs:
    plan = grid(*SHAPES[a], side_m=4.0)
    return [(seen(plan, range(s), noise=Noise(0.0, 0.0)), plan)]


def describe(pairs: Pairs, results: Sequence[MatchResult]) -> str:
    """A single answer in words; for several, the number of unique and perfect ones."""
    counts = [len(r.rooms) + len(r.wall_surfaces) for r in results]
    wrong = [sum(s != f"s:{a}" for s, a, _ in (*r.rooms, *r.wall_surfaces)) for r in results]
    if len(results) > 1:
        whole = [len(s.rooms) + len(s.wall_surfaces) for s, _ in pairs]
        every = zip(results, counts, wrong, whole, strict=True)
        return str(sum(r.status == "unique" and not bad and count == all_of for r, count, bad, all_of in every))
    (result,), (count,), (bad,) = results, counts, wrong
    if result.status == "none":
        return "none"
    first = f"{bad} of {count} wrong" if bad else "right"
    if result.status == "ambiguous":
        return f"{result.reason.split()[0]} tie, {count} pairs each; the first is {first}"
    return f"unique, {first}"
