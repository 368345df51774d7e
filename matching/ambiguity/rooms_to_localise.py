"""How many rooms a robot must see, starting from a given room, before its place in the building is determined.

Rooms are entered in the order of the shortest way from the start. As long as the matcher cannot localise even a perfect
map, it cannot localise a noisy one. From there on it is tested on maps with the noise of real scans (regime `real` of
`data.synthetic_maps.noise_models`), one more room at a time, until it clearly localises most of them. More rooms do not
always help (walls that are not in the plan reduce confidence, a room may add no information), so the reported number is
the one that best splits the results into maps that are not localised below it and maps that are from it on.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from data import SceneGraph
from data.geometry import se2
from data.synthetic_maps.exploration import Storey, Walk, nearest_first
from data.synthetic_maps.noise_models import DrawnGraph, draw_walk, perfect_map
from matching.ambiguity.symmetries import SelfSimilarity
from matching.result import AnyMatcher, MatchResult

NEAR_M, NEAR_RAD = 0.5, float(np.radians(5))  # from the true pose, at the map's centroid
STOP_AHEAD, STOP_BEHIND = 4, 5  # trials stop when this many more maps are localised than not, or fewer
CLEAR_SHARE = 0.75  # of the maps
SINGLE_STEPS = 8  # up to this many rooms each count is tested
STEP_GROWTH = 1.15  # ratio of successive counts above

Rooms = frozenset[int]  # indices into the storey's rooms
Outcome = Literal["known", "never", "not found", "no walls"]


@dataclass(frozen=True)
class Trials:
    """`localised` of `total` noisy maps of the same rooms are localised correctly."""

    localised: int
    total: int

    @property
    def share(self) -> float:
        """The share of maps that are localised."""
        return self.localised / self.total

    @property
    def lead(self) -> int:
        """How many more maps are localised than not."""
        return 2 * self.localised - self.total

    @property
    def clearly_localised(self) -> bool:
        """Whether most maps are localised beyond reasonable doubt."""
        return self.lead >= STOP_AHEAD and self.share >= CLEAR_SHARE

    def decided(self, max_maps: int) -> bool:
        """Whether further trials, up to `max_maps`, are unnecessary or cannot change the majority."""
        decided = self.lead >= STOP_AHEAD or self.lead <= -STOP_BEHIND
        return decided or self.total >= max_maps or abs(self.lead) > max_maps - self.total


@dataclass
class MatchCache:
    """Draws maps of rooms of one storey, matches them and caches the results, since walks from different rooms see the
    same rooms; at most `max_maps` for each set of rooms.

    `index` is the storey's place in `storeys_of`. Each map depends on the seed, the storey, the rooms and its number
    alone, not on earlier calls.
    """

    a: SceneGraph
    storey: Storey
    index: int
    matcher: AnyMatcher
    seed: int
    max_maps: int
    _perfect: dict[Rooms, bool] = field(default_factory=dict)
    _trials: dict[Rooms, Trials] = field(default_factory=dict)

    def localises_perfect_map(self, rooms: Rooms) -> bool:
        """Whether the matcher localises a perfect map of these rooms."""
        if rooms not in self._perfect:
            self._perfect[rooms] = self._localises(perfect_map(self.a, {self.storey.rooms[k].id for k in rooms}))
        return self._perfect[rooms]

    def trials(self, rooms: Rooms) -> Trials:
        """Results on maps with the noise of real scans, drawn until the majority is decided."""
        if rooms not in self._trials:
            now = Trials(0, 0)
            while not now.decided(self.max_maps):
                now = Trials(now.localised + self._localises(self._map(rooms, now.total)), now.total + 1)
            self._trials[rooms] = now
        return self._trials[rooms]

    def _map(self, rooms: Rooms, number: int) -> DrawnGraph:
        order = sorted(rooms)
        rng = np.random.default_rng((self.seed, self.index, number, *order))
        return draw_walk(self.storey, Walk(tuple(order), (-1,) * len(order)), "real", rng)

    def _localises(self, drawn: DrawnGraph) -> bool:
        return bool(drawn.s_graph.wall_surfaces) and _is_correct(self.matcher.match(drawn.s_graph, self.a), drawn)


def _is_correct(result: MatchResult, drawn: DrawnGraph) -> bool:
    """Whether the match is unique and within 0.5 m and 5 degrees of the true pose."""
    if result.status != "unique" or result.T_a_s is None or result.floor != drawn.floor:
        return False
    estimate, true, middle = np.array(result.T_a_s), np.array(drawn.T_a_s), drawn.s_graph.centroid()
    error = float(np.hypot(*(se2.apply(estimate, middle) - se2.apply(true, middle))))
    return error < NEAR_M and abs(float(se2.wrap(estimate[:1] - true[:1])[0])) < NEAR_RAD


@dataclass(frozen=True)
class RoomsToLocalise:
    """How many rooms must be seen from one start room.

    `rooms`: with this many or more, most of the drawn maps are localised; None where most never are. `outcome` is then
    `never` where all reachable rooms fit another place as well, `not found` where the matcher fails, `no walls` where
    the start room has none. `rooms_if_perfect`: the fewest rooms with which a perfect map is localised, None where it
    never is. `trials`: for each tested count the rooms, the maps localised and the maps drawn. `reachable` rooms can be
    reached in all, `by_doors` of them through the model's doors.
    """

    room: str
    floor: str | None
    outcome: Outcome
    rooms: int | None
    rooms_if_perfect: int | None
    trials: tuple[tuple[int, int, int], ...]
    reachable: int
    by_doors: int


def rooms_to_localise(cache: MatchCache, start: int, similarity: SelfSimilarity) -> RoomsToLocalise:
    """The result for the start room of that index in the cache's storey; `similarity` is the A-graph's."""
    storey = cache.storey
    walk, by_doors = nearest_first(storey, start)
    order, room = walk.rooms, storey.rooms[start].id

    def result(
        outcome: Outcome, rooms: int | None, if_perfect: int | None, trials: dict[int, Trials]
    ) -> RoomsToLocalise:
        rows = tuple((count, of.localised, of.total) for count, of in trials.items())
        return RoomsToLocalise(room, storey.floor, outcome, rooms, if_perfect, rows, len(order), by_doors)

    if not len(storey.walls_of[start]):
        return result("no walls", None, None, {})
    if_perfect = _rooms_if_perfect(cache, order)
    if if_perfect is None:
        symmetric = similarity.symmetries([storey.rooms[k].id for k in order])
        return result("never" if symmetric else "not found", None, None, {})
    trials = {}
    for count in _tested_counts(if_perfect, len(order)):
        trials[count] = cache.trials(frozenset(order[:count]))
        if trials[count].clearly_localised:
            break
    rooms = best_split(trials)
    return result("not found" if rooms is None else "known", rooms, if_perfect, trials)


def _rooms_if_perfect(cache: MatchCache, order: Sequence[int]) -> int | None:
    """The fewest rooms, in this order, of which a perfect map is localised: more rooms never make it worse."""
    low, high = 0, 1
    while not cache.localises_perfect_map(frozenset(order[:high])):
        if high == len(order):
            return None
        low, high = high, min(2 * high, len(order))
    while high - low > 1:
        middle = (low + high) // 2
        known = cache.localises_perfect_map(frozenset(order[:middle]))
        low, high = (low, middle) if known else (middle, high)
    return high


def best_split(trials: dict[int, Trials]) -> int | None:
    """The count from which on localised maps outweigh the others most: the best step fit to a share that grows.

    The smallest of equals; None where localised maps nowhere outweigh the others.
    """
    found, best, above = None, 0.0, 0.0
    for count, of in reversed(trials.items()):
        above += of.share - 0.5
        if above > 0 and above >= best:
            found, best = count, above
    return found


def _tested_counts(first: int, last: int) -> Iterator[int]:
    """The numbers of rooms that are tested."""
    rooms = first
    while rooms < last:
        yield rooms
        rooms = rooms + 1 if rooms < SINGLE_STEPS else math.ceil(rooms * STEP_GROWTH)
    yield last
