"""Answers of the combinatorial search and of its public code to symmetries, mirrored maps and spurious walls."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from data import SceneGraph, WallSurface
from evaluation.published.combinatorial_layouts import Noise, grid, seen, subset
from matching.result import MatchResult

Match = Callable[[SceneGraph, SceneGraph], MatchResult]
L_SHAPE = (0, 1, 5)  # rooms of the plan of 8 without a mirror or rotational symmetry
EXACT = Noise(0.0, 0.0)
SEEDS = 10


@dataclass(frozen=True)
class Question:
    """Pairs of an S-graph and an A-graph, with the answers of the released public code and of its later branch."""

    what: str
    pairs: tuple[tuple[SceneGraph, SceneGraph], ...]
    released: str
    later: str


def questions() -> list[Question]:
    """All questions."""
    plan = grid(4, 2)
    s = seen(plan, L_SHAPE)
    found = [_twins(*shape, *answers) for shape, answers in TWINS]
    spurious = WallSurface("spurious", s.rooms[0].id, s.rooms[0].centroid, (1.0, 0.0), 1.0)
    found += [
        Question("as built, 8:3", ((s, plan),), "unique, right", "unique, right"),
        Question("the building mirrored", ((seen(plan, L_SHAPE, mirrored=True), plan),), "unique", "none"),
        Question("S turned by 90°", ((seen(plan, L_SHAPE, turned=np.pi / 2), plan),), "as not turned", "none"),
        Question(
            "one spurious 5th wall in a room",
            ((replace(s, wall_surfaces=(*s.wall_surfaces, spurious)), plan),), "none", "none",
        ),
        Question(
            "one wall missing", ((replace(s, wall_surfaces=s.wall_surfaces[1:]), plan),), "unique", "unique"
        ),
        Question("more rooms in S than in A", ((seen(plan, L_SHAPE), grid(2, 1)),), "none", "none"),
        Question("one room in S", ((seen(plan, (0,)), plan),), "4 tie, 5 pairs each", "1 answer"),
        Question("S empty", ((SceneGraph("map"), plan),), "raises IndexError", ""),
    ]  # fmt: skip
    for noise, released, later in NOISES:
        pairs = []
        for seed in range(SEEDS):
            own = grid(4, 2, seed=seed)
            pairs.append((seen(own, subset(own, 3, seed), seed, noise), own))
        what = f"noise {100 * noise.metres:g} cm, {noise.degrees:g}°, 8:3, {SEEDS} buildings"
        found.append(Question(what, tuple(pairs), released, later))
    return found


TWINS: Sequence[tuple[tuple[int, int, int], tuple[str, str]]] = (
    ((2, 1, 2), ("4 tie", "unique, right")), ((2, 2, 2), ("16 tie", "ambiguous")),
    ((2, 2, 3), ("8 tie", "unique, right")), ((2, 2, 4), ("more than 1 tie", "unique, right")),
)  # fmt: skip
NOISES = (
    (Noise(0.03, 0.5), "10 unique and perfect", ""), (Noise(0.06, 1.0), "9 unique and perfect", "7"),
    (Noise(0.10, 1.5), "5 unique and perfect", "1"),
)  # fmt: skip


def _twins(columns: int, rows: int, rooms: int, released: str, later: str) -> Question:
    plan = grid(columns, rows, side_m=4.0)
    what = f"twins: equal squares, {columns * rows}:{rooms}"
    return Question(what, ((seen(plan, range(rooms), noise=EXACT), plan),), released, later)


def behaviour(released: Match, later: Match) -> str:
    """The Markdown table of questions and answers."""
    lines = ["| asked | public code, released | ours | public code, later branch | ours |", "|---|---|---|---|---|"]
    for q in questions():
        ours = (describe_answer(q, [match(*pair) for pair in q.pairs]) for match in (released, later))
        first, second = ours
        lines.append(f"| {q.what} | {q.released} | {first} | {q.later} | {second} |")
    return "\n".join(lines) + "\n"


def describe_answer(question: Question, results: Sequence[MatchResult]) -> str:
    """A single answer in words; for several, the number of unique and perfect ones."""
    if len(results) > 1:
        pairs = zip(results, question.pairs, strict=True)
        return str(sum(r.status == "unique" and not wrong(r) and complete(r, s) for r, (s, _) in pairs))
    (result,) = results
    if result.status == "none":
        return "none"
    count = len(result.rooms) + len(result.wall_surfaces)
    first = "right" if not wrong(result) else f"{wrong(result)} of {count} wrong"
    if result.status == "ambiguous":
        return f"{result.reason.split()[0]} tie, {count} pairs each; the first is {first}"
    return f"unique, {first}"


def wrong(result: MatchResult) -> int:
    """The number of wrong pairs."""
    return sum(s != f"s:{a}" for s, a, _ in (*result.rooms, *result.wall_surfaces))


def complete(result: MatchResult, s: SceneGraph) -> bool:
    """Whether all rooms and walls are matched."""
    return len(result.rooms) == len(s.rooms) and len(result.wall_surfaces) == len(s.wall_surfaces)
