"""Results of methods without verification."""

import time
from collections import Counter

from data.geometry.se2 import Array
from data.scene_graph import SceneGraph
from matching.result import Hypothesis, MatchResult, Pair
from matching.search.start import Start, near_start


def unchecked(
    a: SceneGraph, rooms: tuple[Pair, ...], walls: tuple[Pair, ...], T_a_s: Array, start: Start | None, reason: str,
    began: float,
) -> MatchResult:  # fmt: skip
    """Returns `unique` for pairs (at least one) and a motion (3,), `none` if it is far from the start.

    `began` is the start time by `time.perf_counter`.
    """
    if start is not None and not near_start(start, T_a_s):
        far = "the answer is not near the start that was given"
        return MatchResult("none", far, seconds=time.perf_counter() - began)
    yaw, x, y = T_a_s.tolist()
    floor = _floor(a, rooms, walls)
    sole = Hypothesis(0.0, (yaw, x, y), floor, tuple((i, j) for i, j, _ in rooms))
    return MatchResult("unique", reason, rooms, walls, (yaw, x, y), floor, (sole,), time.perf_counter() - began)


def _floor(a: SceneGraph, rooms: tuple[Pair, ...], walls: tuple[Pair, ...]) -> str | None:
    """The floor with most of the partners."""
    floors = [a.room_by_id[j].floor for _, j, _ in rooms]
    for _, j, _ in walls:
        wall = a.surface_by_id[j]
        floors.append(a.room_by_id[wall.room].floor if wall.room is not None else wall.floor)
    return Counter(floors).most_common(1)[0][0]
