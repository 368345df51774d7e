"""Results of methods without verification."""

import time
from collections import Counter
from collections.abc import Callable

from data.geometry.se2 import Array
from data.scene_graph import SceneGraph
from matching.result import Hypothesis, MatchResult, Pair
from matching.search.start import Start, near_start

Pairs = tuple[Pair, ...]
PairsOf = Callable[[SceneGraph, SceneGraph], tuple[Pairs, Pairs]]
MotionOf = Callable[[SceneGraph, SceneGraph, Pairs, Pairs], Array]


def match_unchecked(
    s: SceneGraph, a: SceneGraph, pairs_of: PairsOf, motion_of: MotionOf, reason: str, no_pairs: str,
    floor: str | None, start: Start | None,
) -> MatchResult:  # fmt: skip
    """The answer of a network whose pairs are not verified: `unique` where it pairs anything.

    `pairs_of` gives the pairs of rooms and of wall surfaces, `motion_of` their T_a_s (3,). `none` where a graph has no
    wall surfaces, nothing is paired (for the reason `no_pairs`), or the motion is far from the start.
    """
    began = time.perf_counter()
    a = a if floor is None else a.on_floor(floor)
    for what, graph in (("S-graph", s), ("A-graph", a)):
        if not graph.wall_surfaces:
            return MatchResult("none", f"the {what} has no wall surface")
    rooms, walls = pairs_of(s, a)
    if not rooms and not walls:
        return MatchResult("none", no_pairs, seconds=time.perf_counter() - began)
    T_a_s = motion_of(s, a, rooms, walls)
    if start is not None and not near_start(start, T_a_s):
        far = "the answer is not near the start that was given"
        return MatchResult("none", far, seconds=time.perf_counter() - began)
    yaw, x, y = T_a_s.tolist()
    storey = _floor(a, rooms, walls)
    sole = Hypothesis(0.0, (yaw, x, y), storey, tuple((i, j) for i, j, _ in rooms))
    return MatchResult("unique", reason, rooms, walls, (yaw, x, y), storey, (sole,), time.perf_counter() - began)


def _floor(a: SceneGraph, rooms: Pairs, walls: Pairs) -> str | None:
    """The floor with most of the partners."""
    floors = [a.room_by_id[j].floor for _, j, _ in rooms]
    for _, j, _ in walls:
        wall = a.surface_by_id[j]
        floors.append(a.room_by_id[wall.room].floor if wall.room is not None else wall.floor)
    return Counter(floors).most_common(1)[0][0]
