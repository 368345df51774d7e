"""What the combinatorial search is asked, with the public code's answers or seconds: symmetries, mirrored maps,
spurious walls, noise; and layouts of growing size."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Generic, Literal, TypeVar

import numpy as np

from data import SceneGraph, WallSurface
from evaluation.published.combinatorial_layouts import Noise, grid, polygons, seen, subset
from matching.result import MatchResult

T = TypeVar("T")
Version = Literal["released", "later"]
Pairs = Sequence[tuple[SceneGraph, SceneGraph]]
L_SHAPE = (0, 1, 5)  # rooms of the plan of 8 without a mirror or rotational symmetry
EXACT = Noise(0.0, 0.0)
SEEDS = 10
SHAPES = {2: (2, 1), 4: (2, 2), 8: (4, 2), 12: (4, 3)}
LATE_S = 300.0  # time limit of the public code's measurement; 120 s for many walls
GIVEN_UP = (LATE_S, 120.0)


@dataclass(frozen=True)
class Question(Generic[T]):
    """Pairs of an S-graph and an A-graph; what was measured on the versions of the public code."""

    pairs: Pairs
    released: T
    later: T

    def public(self, version: Version) -> T:
        """What was measured on a version."""
        return self.released if version == "released" else self.later


def questions() -> dict[str, Question[str]]:
    """The questions, by name, with the answers of the public code."""
    plan = grid(4, 2)
    s = seen(plan, L_SHAPE)
    found = {f"twins: equal squares, {shape[0] * shape[1]}:{n}": _twins(shape, n, *of) for shape, n, of in TWINS}
    spurious = WallSurface("spurious", s.rooms[0].id, s.rooms[0].centroid, (1.0, 0.0), 1.0)
    with_spurious = replace(s, wall_surfaces=(*s.wall_surfaces, spurious))
    found |= {
        "as built, 8:3": Question([(s, plan)], "unique, right", "unique, right"),
        "the building mirrored": Question([(seen(plan, L_SHAPE, mirrored=True), plan)], "unique", "none"),
        "S turned by 90°": Question([(seen(plan, L_SHAPE, turned=np.pi / 2), plan)], "as not turned", "none"),
        "one spurious 5th wall in a room": Question([(with_spurious, plan)], "none", "none"),
        "one wall missing": Question([(replace(s, wall_surfaces=s.wall_surfaces[1:]), plan)], "unique", "unique"),
        "more rooms in S than in A": Question([(s, grid(2, 1))], "none", "none"),
        "one room in S": Question([(seen(plan, (0,)), plan)], "4 tie, 5 pairs each", "1 answer"),
        "S empty": Question([(SceneGraph("map"), plan)], "raises IndexError", ""),
    }
    for noise, released, later in NOISES:
        plans = [grid(4, 2, seed=seed) for seed in range(SEEDS)]
        pairs = [(seen(own, subset(own, 3, seed), seed, noise), own) for seed, own in enumerate(plans)]
        name = f"noise {100 * noise.metres:g} cm, {noise.degrees:g}°, 8:3, {SEEDS} buildings"
        found[name] = Question(pairs, released, later)
    return found


def layouts() -> dict[str, Question[float | None]]:
    """The layouts, by name, with the seconds of the public code (None: not measured): uneven rooms A:S rooms, rooms
    with many walls, equal squares."""
    found: dict[str, Question[float | None]] = {}
    for (a, s), released, later in GRIDS:
        plan = grid(*SHAPES[a])
        found[f"{a}:{s}"] = Question([(seen(plan, subset(plan, s)), plan)], released, later)
    for walls, seconds in WALLS:
        plan = polygons(2, walls)
        found[f"2:2, {walls} walls a room"] = Question([(seen(plan, (0, 1)), plan)], seconds, None)
    for s, seconds in SQUARES:
        plan = grid(2, 2, side_m=4.0)
        found[f"4:{s}, equal squares"] = Question([(seen(plan, range(s), noise=EXACT), plan)], seconds, None)
    return found


TWINS = (
    ((2, 1), 2, ("4 tie", "unique, right")), ((2, 2), 2, ("16 tie", "ambiguous")),
    ((2, 2), 3, ("8 tie", "unique, right")), ((2, 2), 4, ("more than 1 tie", "unique, right")),
)  # fmt: skip
NOISES = (
    (Noise(0.03, 0.5), "10 unique and perfect", ""), (Noise(0.06, 1.0), "9 unique and perfect", "7"),
    (Noise(0.10, 1.5), "5 unique and perfect", "1"),
)  # fmt: skip
GRIDS: Sequence[tuple[tuple[int, int], float | None, float | None]] = (
    ((2, 2), 0.18, 0.31), ((4, 2), 0.28, 0.38), ((4, 3), 0.71, 0.79), ((4, 4), 3.9, 2.5), ((8, 2), 0.32, 1.3),
    ((8, 3), 0.88, 2.0), ((8, 4), 3.7, 4.8), ((8, 5), 16.9, 37.0), ((8, 6), 98.9, 135.0), ((8, 8), LATE_S, LATE_S),
    ((12, 2), 0.16, 1.1), ((12, 3), 0.74, 3.1), ((12, 4), 6.8, 57.7), ((12, 5), 86.0, LATE_S),
    ((12, 6), LATE_S, None), ((12, 12), None, None),
)  # fmt: skip
WALLS = ((4, 0.24), (5, 0.63), (6, 2.9), (7, 25.8), (8, 120.0))
SQUARES = ((3, 10.5), (4, 89.0))
HEAVY = ("12:6", "12:12", "2:2, 8 walls a room")  # layouts that stop one of our versions at a minute


def _twins(shape: tuple[int, int], rooms: int, released: str, later: str) -> Question[str]:
    plan = grid(*shape, side_m=4.0)
    return Question([(seen(plan, range(rooms), noise=EXACT), plan)], released, later)


def describe(pairs: Pairs, results: Sequence[MatchResult]) -> str:
    """A single answer in words; for several, the number of unique and perfect ones."""
    if len(results) > 1:
        every = zip(results, pairs, strict=True)
        return str(sum(r.status == "unique" and not _wrong(r) and _complete(r, s) for r, (s, _) in every))
    (result,) = results
    if result.status == "none":
        return "none"
    count = len(result.rooms) + len(result.wall_surfaces)
    first = "right" if not _wrong(result) else f"{_wrong(result)} of {count} wrong"
    if result.status == "ambiguous":
        return f"{result.reason.split()[0]} tie, {count} pairs each; the first is {first}"
    return f"unique, {first}"


def _wrong(result: MatchResult) -> int:
    """The number of wrong pairs."""
    return sum(s != f"s:{a}" for s, a, _ in (*result.rooms, *result.wall_surfaces))


def _complete(result: MatchResult, s: SceneGraph) -> bool:
    """Whether all rooms and walls are matched."""
    return len(result.rooms) == len(s.rooms) and len(result.wall_surfaces) == len(s.wall_surfaces)
