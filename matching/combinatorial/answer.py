"""The solutions of the combinatorial search as a match result, with the motion that fits their pairs best."""

from collections.abc import Sequence

import numpy as np

from data.geometry.se2 import Array
from data.scene_graph import SceneGraph
from matching.combinatorial.affinity import Datums
from matching.combinatorial.merge import Merged
from matching.result import Hypothesis, MatchResult
from matching.search import fit_pairs

LISTED = 10  # hypotheses in the result, at most


def answer(
    s: Datums, a: Datums, plan: SceneGraph, solutions: Sequence[Merged], motions: Sequence[Array], seconds: float
) -> MatchResult:
    """Returns `unique` for one solution, `ambiguous` for several (the first found is then as good as any)."""
    if not solutions:
        return MatchResult("none", "no set of rooms and walls agrees with the plan", seconds=seconds)
    count, first = len(solutions), solutions[0]
    floor = plan.room_by_id[a.rooms[first.rooms[0][1]]].floor
    hypotheses = []
    for m, T in zip(solutions[:LISTED], motions, strict=False):
        rooms = tuple((s.rooms[r], a.rooms[q]) for r, q in m.rooms)
        hypotheses.append(Hypothesis(m.consistency, _triple(T), plan.room_by_id[rooms[0][1]].floor, rooms))
    sure = min(first.consistency, 1.0) / count
    return MatchResult(
        "unique" if count == 1 else "ambiguous",
        "one solution" if count == 1 else f"{count} solutions are as good as each other",
        tuple((s.rooms[r], a.rooms[q], sure) for r, q in first.rooms),
        tuple((s.walls[i], a.walls[j], sure) for i, j in first.walls),
        _triple(motions[0]), floor, tuple(hypotheses), seconds,
    )  # fmt: skip


def fitted(s: Datums, a: Datums, m: Merged) -> Array:
    """(yaw, x, y) of the proper motion T_a_s that fits a solution best."""
    (i, j), (r, q) = (np.array(pairs, dtype=np.int64).T for pairs in (m.walls, m.rooms))
    return fit_pairs(
        np.hstack((s.point[i], s.normal[i])), np.hstack((a.point[j], a.normal[j])), s.place[r, :2], a.place[q, :2]
    )  # fmt: skip


def _triple(T: Array) -> tuple[float, float, float]:
    yaw, x, y = T.tolist()
    return yaw, x, y
