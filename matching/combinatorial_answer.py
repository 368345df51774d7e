"""The solutions of the combinatorial search as an answer, with the motion that fits their pairs best."""

from collections.abc import Sequence

import numpy as np

from data import se2
from data.scene_graph import SceneGraph
from matching.combinatorial_affinity import Datums
from matching.combinatorial_merge import Merged
from matching.result import Hypothesis, MatchResult
from matching.se2 import Array

LISTED = 10  # hypotheses in the answer
ROOM_WEIGHT = 0.1  # of a centre, beside a wall: it decides only where walls leave the place open


def answer(
    s: Datums, a: Datums, plan: SceneGraph, solutions: Sequence[Merged], motions: Sequence[Array], seconds: float
) -> MatchResult:
    """`unique` for one solution, `ambiguous` for several: the first found is then as good as any."""
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
    """(yaw, x, y) of the proper motion T_a_s that lays the walls' lines and the rooms' centres on each other."""
    i, j = np.array(m.walls, dtype=np.int64).T
    r, q = np.array(m.rooms, dtype=np.int64).T
    complex_s, complex_a = (normal @ np.array([1.0, 1.0j]) for normal in (s.normal[i], a.normal[j]))
    turn = float(np.angle(np.sum(complex_a * complex_s.conj())))
    off = a.point[j] - se2.rotate(turn, s.point[i])
    apart = a.place[q, :2] - se2.rotate(turn, s.place[r, :2])
    rows = [a.normal[j], *(ROOM_WEIGHT * np.tile(axis, (len(r), 1)) for axis in np.eye(2))]
    values = [np.sum(a.normal[j] * off, axis=-1), *(ROOM_WEIGHT * apart[:, k] for k in (0, 1))]
    shift = np.linalg.lstsq(np.concatenate(rows), np.concatenate(values), rcond=None)[0]
    return np.array([turn, *shift])


def _triple(T: Array) -> tuple[float, float, float]:
    yaw, x, y = T.tolist()
    return yaw, x, y
