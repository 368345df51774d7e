"""How many rooms a robot must see, from each room on, before it can know where in the building it is.

From a start room the rooms are entered in the order of the way there. While the matcher does not know even a perfect
map it knows none; from there on it is asked after maps with the noise of real scans (regime `real` of
`data.synthetic_maps.noise_models`), room after room, until it clearly knows most of them. With more rooms a map is not
always better known (walls that are not in the plan cost trust, a room may tell nothing new), so the number told is the
one that divides the answers best into unknown maps before it and known ones from it on.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from data.synthetic_maps.walks import nearest_first
from matching.ambiguity.match_cache import Answers, AskedMaps, Rooms
from matching.ambiguity.self_similarity import OwnTwins

EACH = 8  # so many rooms are asked after one by one,
GROWTH = 1.15  # then this many times more each

Outcome = Literal["known", "never", "not found", "nothing to see"]


@dataclass(frozen=True)
class RoomsNeeded:
    """`rooms`: from so many on most of the maps that were drawn are known; None where most are not in the end.

    Then the outcome is `never` where a twin explains all that can be seen from there, `not found` where the matcher
    does not find it, `nothing to see` where the start has no walls. With fewer than `apart` rooms the matcher does not
    know a perfect map, None where it never does. `asked`: after how many rooms, how many maps were known, of how many.
    `reachable` rooms are reached in all, `by_doors` of them through the model's doors.
    """

    room: str
    floor: str | None
    outcome: Outcome
    rooms: int | None
    apart: int | None
    asked: tuple[tuple[int, int, int], ...]
    reachable: int
    by_doors: int


def needed_from(maps: AskedMaps, start: int, own: OwnTwins) -> RoomsNeeded:
    """Of one start room of the storey that is asked after. `own` are the A-graph's twins."""
    storey = maps.storey
    walked, by_doors = nearest_first(storey, start)
    order = walked.rooms

    def told(outcome: Outcome, rooms: int | None, apart: int | None, asked: dict[int, Answers]) -> RoomsNeeded:
        each = tuple((count, of.known, of.of) for count, of in asked.items())
        return RoomsNeeded(storey.rooms[start].id, storey.floor, outcome, rooms, apart, each, len(order), by_doors)

    if not len(storey.walls_of[start]):
        return told("nothing to see", None, None, {})
    apart = _apart(maps, order)
    if apart is None:
        twins = own.of([storey.rooms[k].id for k in order])
        return told("never" if twins else "not found", None, None, {})
    asked = {}
    for count in _stages(apart, len(order)):
        asked[count] = maps.answers(_first(order, count))
        if asked[count].clearly_known:
            break
    rooms = dividing(asked)
    return told("not found" if rooms is None else "known", rooms, apart, asked)


def _first(order: Sequence[int], count: int) -> Rooms:
    return frozenset(order[:count])


def _apart(maps: AskedMaps, order: Sequence[int]) -> int | None:
    """After how many rooms, entered in this order, a perfect map is known: the more it holds, the better it is."""
    low, high = 0, 1
    while not maps.perfect_is_known(_first(order, high)):
        if high == len(order):
            return None
        low, high = high, min(2 * high, len(order))
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if maps.perfect_is_known(_first(order, middle)) else (middle, high)
    return high


def dividing(asked: dict[int, Answers]) -> int | None:
    """The count from which on the known maps outweigh the others most, None where they nowhere do; of equals the
    smallest. It is the best guess of a share that grows."""
    found, best, above = None, 0.0, 0.0
    for count, answers in reversed(asked.items()):
        above += answers.share - 0.5
        if above > 0 and above >= best:
            found, best = count, above
    return found


def _stages(first: int, last: int) -> Iterator[int]:
    """After how many rooms the matcher is asked."""
    rooms = first
    while rooms < last:
        yield rooms
        rooms = rooms + 1 if rooms < EACH else math.ceil(rooms * GROWTH)
    yield last
