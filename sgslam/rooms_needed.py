"""How many rooms a robot must see, from each room on, before it can know where in the building it is.

From a start room the rooms are entered in the order of the way there, and the map has the noise of real scans (regime
`real` of `data.s_graph_regimes`). As long as another place of the plan explains even a perfect map as well (a twin),
nobody can know; from there on the matcher is asked after each room, until it names the one true place in most maps.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from data import SceneGraph, se2
from data.s_graph_exploration import Storey
from data.s_graph_regimes import DrawnGraph, draw_walk
from data.s_graph_walks import nearest_first, seen_in
from sgslam.matcher_protocol import AnyMatcher, Match
from sgslam.own_twins import OwnTwins

NEAR_M, NEAR_RAD = 0.5, float(np.radians(5))  # of the truth, at the map's middle
EACH = 8  # so many rooms are asked after one by one,
GROWTH = 1.15  # then this many times more each

Outcome = Literal["known", "never", "not found", "nothing to see"]


@dataclass(frozen=True)
class RoomsNeeded:
    """`rooms`: after so many most of the maps that were drawn are known; None where most are not in the end.

    Then the outcome is `never` where a twin explains all that can be seen from there, `not found` where the matcher
    does not find it, `nothing to see` where the start has no walls. `apart` rooms leave no twin of a perfect map, None
    where all do. `asked`: after how many rooms, how many maps were known, of how many that were asked: no more are than
    decide. `reachable` rooms are reached in all, `by_doors` of them through the model's doors.
    """

    room: str
    floor: str | None
    outcome: Outcome
    rooms: int | None
    apart: int | None
    asked: tuple[tuple[int, int, int], ...]
    reachable: int
    by_doors: int


def needed_from(
    storey: Storey, start: int, a: SceneGraph, matcher: AnyMatcher, rngs: Sequence[np.random.Generator], own: OwnTwins
) -> RoomsNeeded:
    """Of one start room, with a map drawn by each of the random generators. `own` are the A-graph's twins."""
    room = storey.rooms[start].id
    walked, by_doors = nearest_first(storey, start)
    order = [storey.rooms[k].id for k in walked.rooms]

    def told(outcome: Outcome, rooms: int | None, apart: int | None, *asked: tuple[int, int, int]) -> RoomsNeeded:
        return RoomsNeeded(room, storey.floor, outcome, rooms, apart, asked, len(order), by_doors)

    if not len(storey.walls_of[start]):
        return told("nothing to see", None, None)
    apart = _apart(own, order)
    if apart is None:
        return told("never", None, None)
    maps = [draw_walk(storey, walked, "real", rng) for rng in rngs]
    asked = []
    for count in _stages(apart, len(order)):
        known, of = _most(maps, set(order[:count]), a, matcher)
        asked.append((count, known, of))
        if 2 * known > len(maps):
            return told("known", count, apart, *asked)
    return told("not found", None, apart, *asked)


def _most(maps: Sequence[DrawnGraph], rooms: set[str], a: SceneGraph, matcher: AnyMatcher) -> tuple[int, int]:
    """In how many maps of these rooms the matcher names the true place alone, and how many were asked until it was
    certain whether these are most."""
    known = 0
    for of, drawn in enumerate(maps, 1):
        seen = seen_in(drawn, rooms)
        known += bool(seen.s_graph.wall_surfaces) and is_right(matcher.match(seen.s_graph, a), seen)
        if 2 * known > len(maps) or 2 * (known + len(maps) - of) <= len(maps):
            break
    return known, of


def _apart(own: OwnTwins, order: list[str]) -> int | None:
    """After how many rooms, entered in this order, a perfect map has no twin: the more it holds, the fewer it has."""
    low, high = 0, 1
    while own.of(order[:high]):
        if high == len(order):
            return None
        low, high = high, min(2 * high, len(order))
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if own.of(order[:middle]) else (low, middle)
    return high


def is_right(result: Match, drawn: DrawnGraph) -> bool:
    """Whether the answer is unique and the true place."""
    if result.status != "unique" or result.T_a_s is None or result.floor != drawn.floor:
        return False
    ours, true, middle = np.array(result.T_a_s), np.array(drawn.T_a_s), drawn.s_graph.centroid()
    off = float(np.hypot(*(se2.apply(ours, middle) - se2.apply(true, middle))))
    return off < NEAR_M and abs(float(se2.wrap(ours[:1] - true[:1])[0])) < NEAR_RAD


def _stages(first: int, last: int) -> Iterator[int]:
    """After how many rooms the matcher is asked."""
    rooms = first
    while rooms < last:
        yield rooms
        rooms = rooms + 1 if rooms < EACH else math.ceil(rooms * GROWTH)
    yield last
