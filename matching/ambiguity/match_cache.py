"""Cached results of a matcher on synthetic maps of one storey: walks from different rooms see the same rooms."""

from dataclasses import dataclass, field

import numpy as np

from data import SceneGraph
from data.geometry import se2
from data.synthetic_maps.exploration import Storey, Walk
from data.synthetic_maps.noise_models import DrawnGraph, draw_walk
from data.synthetic_maps.walks import perfect_map
from matching.result import AnyMatcher, MatchResult

NEAR_M, NEAR_RAD = 0.5, float(np.radians(5))  # from the true pose, at the map's centroid
STOP_AHEAD, STOP_BEHIND = 4, 5  # trials stop when this many more maps are localised than not, or fewer
CLEAR_SHARE = 0.75  # of the maps

Rooms = frozenset[int]  # indices into the storey's rooms


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
    """Draws maps of rooms of one storey, matches them and caches the results; at most `max_maps` for each set of rooms.

    `index` is the storey's place in `storeys_of`. Each map depends on the seed, the storey, the rooms and its number
    alone, not on earlier calls.
    """

    a: SceneGraph
    storey: Storey
    index: int
    matcher: AnyMatcher
    seed: int
    max_maps: int
    _trials: dict[Rooms, Trials] = field(default_factory=dict)
    _sufficient: list[Rooms] = field(default_factory=list)
    _insufficient: list[Rooms] = field(default_factory=list)

    def localises_perfect_map(self, rooms: Rooms) -> bool:
        """Whether the matcher localises a perfect map of these rooms.

        Adding rooms to a localised map keeps it localised, and removing rooms from one that is not does not help:
        results that follow from earlier ones are not computed.
        """
        if any(rooms >= fewer for fewer in self._sufficient):
            return True
        if any(rooms <= more for more in self._insufficient):
            return False
        localised = self._localises(perfect_map(self.a, {self.storey.rooms[k].id for k in rooms}))
        (self._sufficient if localised else self._insufficient).append(rooms)
        return localised

    def trials(self, rooms: Rooms) -> Trials:
        """Results on maps with the noise of real scans, drawn until the majority is decided."""
        if rooms not in self._trials:
            now = Trials(0, 0)
            while not now.decided(self.max_maps):
                now = Trials(now.localised + self._localises(self._map(rooms, now.total)), now.total + 1)
            self._trials[rooms] = now
        return self._trials[rooms]

    def clear_perfect_maps(self) -> None:
        """Discards the results on perfect maps, so that nothing is inferred from them."""
        self._sufficient.clear()
        self._insufficient.clear()

    def _map(self, rooms: Rooms, number: int) -> DrawnGraph:
        order = sorted(rooms)
        rng = np.random.default_rng((self.seed, self.index, number, *order))
        return draw_walk(self.storey, Walk(tuple(order), (-1,) * len(order)), "real", rng)

    def _localises(self, drawn: DrawnGraph) -> bool:
        return bool(drawn.s_graph.wall_surfaces) and is_correct(self.matcher.match(drawn.s_graph, self.a), drawn)


def is_correct(result: MatchResult, drawn: DrawnGraph) -> bool:
    """Whether the match is unique and within 0.5 m and 5 degrees of the true pose."""
    if result.status != "unique" or result.T_a_s is None or result.floor != drawn.floor:
        return False
    estimate, true, middle = np.array(result.T_a_s), np.array(drawn.T_a_s), drawn.s_graph.centroid()
    error = float(np.hypot(*(se2.apply(estimate, middle) - se2.apply(true, middle))))
    return error < NEAR_M and abs(float(se2.wrap(estimate[:1] - true[:1])[0])) < NEAR_RAD
