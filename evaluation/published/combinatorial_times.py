"""Times of the combinatorial search against its public code on layouts of the same kind."""

import time
from collections.abc import Sequence
from dataclasses import dataclass

from data import SceneGraph
from evaluation.published.combinatorial_behaviour import EXACT, Match
from evaluation.published.combinatorial_layouts import grid, polygons, seen, subset

SHAPES = {2: (2, 1), 4: (2, 2), 8: (4, 2), 12: (4, 3)}
LATE_S = 300.0  # time limit of the public code's measurement; 120 s for many walls


@dataclass(frozen=True)
class Layout:
    """A pair, with the seconds of the released public code and of its later branch (None: not measured)."""

    name: str
    s: SceneGraph
    a: SceneGraph
    released_s: float | None
    later_s: float | None


def layouts() -> list[Layout]:
    """All layouts: uneven rooms A:S, rooms with many walls, equal squares."""
    found = []
    for (a, s), released, later in GRIDS:
        plan = grid(*SHAPES[a])
        found.append(Layout(f"{a}:{s}", seen(plan, subset(plan, s)), plan, released, later))
    for walls, released in WALLS:
        plan = polygons(2, walls)
        found.append(Layout(f"2:2, {walls} walls a room", seen(plan, (0, 1)), plan, released, None))
    for s, released in SQUARES:
        plan = grid(2, 2, side_m=4.0)
        found.append(Layout(f"4:{s}, equal squares", seen(plan, range(s), noise=EXACT), plan, released, None))
    return found


GRIDS: Sequence[tuple[tuple[int, int], float | None, float | None]] = (
    ((2, 2), 0.18, 0.31), ((4, 2), 0.28, 0.38), ((4, 3), 0.71, 0.79), ((4, 4), 3.9, 2.5), ((8, 2), 0.32, 1.3),
    ((8, 3), 0.88, 2.0), ((8, 4), 3.7, 4.8), ((8, 5), 16.9, 37.0), ((8, 6), 98.9, 135.0), ((8, 8), LATE_S, LATE_S),
    ((12, 2), 0.16, 1.1), ((12, 3), 0.74, 3.1), ((12, 4), 6.8, 57.7), ((12, 5), 86.0, LATE_S),
    ((12, 6), LATE_S, None), ((12, 12), None, None),
)  # fmt: skip
WALLS = ((4, 0.24), (5, 0.63), (6, 2.9), (7, 25.8), (8, 120.0))
SQUARES = ((3, 10.5), (4, 89.0))
GIVEN_UP = (LATE_S, 120.0)


def times(released: Match, later: Match, limit_s: float) -> tuple[str, float]:
    """The Markdown table, and the largest ratio of our time to the public code's.

    If ours was stopped, its time is a bound and the row has no ratio.
    """
    lines = ["| layout | released: public code s | ours s | ratio | later branch: public code s | ours s | ratio |"]
    lines.append("|---|---|---|---|---|---|---|")
    ratios = []
    for layout in layouts():
        cells = []
        for match, theirs in ((released, layout.released_s), (later, layout.later_s)):
            began = time.process_time()
            result = match(layout.s, layout.a)
            took, ended = time.process_time() - began, result.seconds < limit_s
            ours = f"{took:.2f}" if ended else f"stopped at {limit_s:g}"
            ratio = ""
            if ended and theirs is not None:
                ratio = f"{'< ' if theirs in GIVEN_UP else ''}{took / theirs:.3f}"
                ratios.append(took / theirs)
            cells += ["" if theirs is None else f"{'> ' if theirs in GIVEN_UP else ''}{theirs:g}", ours, ratio]
        print(" | ".join((layout.name, *cells)), flush=True)
        lines.append(f"| {layout.name} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n", max(ratios)
