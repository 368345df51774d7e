"""What the matcher answers on maps of rooms of one storey, kept: ways from different rooms lead to the same ones."""

from dataclasses import dataclass, field

import numpy as np

from data import SceneGraph
from data.geometry import se2
from data.synthetic_maps.exploration import Storey, Walk
from data.synthetic_maps.noise_models import DrawnGraph, draw_walk
from data.synthetic_maps.walks import perfect_map
from matching.protocol import AnyMatcher, Match

NEAR_M, NEAR_RAD = 0.5, float(np.radians(5))  # of the truth, at the map's middle
AHEAD, BEHIND = 4, 5  # maps; where so many more are known than not, or fewer, no more are asked
CLEAR = 0.75  # of the maps

Rooms = frozenset[int]  # by their places in the storey


@dataclass(frozen=True)
class Answers:
    """On `of` maps of the same rooms: how many were known."""

    known: int
    of: int

    @property
    def share(self) -> float:
        """Of the maps."""
        return self.known / self.of

    @property
    def lead(self) -> int:
        """By how many maps the known ones are ahead."""
        return 2 * self.known - self.of

    @property
    def clearly_known(self) -> bool:
        """Whether most are known beyond much doubt."""
        return self.lead >= AHEAD and self.share >= CLEAR

    def decided(self, most: int) -> bool:
        """Whether it is clear, or of `most` maps the rest cannot change, whether most are known."""
        return self.lead >= AHEAD or self.lead <= -BEHIND or self.of >= most or abs(self.lead) > most - self.of


@dataclass
class AskedMaps:
    """Asks the matcher after maps of rooms of one storey, the `place`th of `storeys_of`; at most `most` of each set.

    Each map depends on seed, storey, rooms and its number alone, not on what was asked before.
    """

    a: SceneGraph
    storey: Storey
    place: int
    matcher: AnyMatcher
    seed: int
    most: int
    _drawn: dict[Rooms, Answers] = field(default_factory=dict)
    _known: list[Rooms] = field(default_factory=list)
    _unknown: list[Rooms] = field(default_factory=list)

    def perfect_is_known(self, rooms: Rooms) -> bool:
        """Whether the matcher knows a perfect map. With more rooms it knows it too, with fewer than unknown ones it
        does not: what follows from earlier answers is not asked."""
        if any(rooms >= fewer for fewer in self._known):
            return True
        if any(rooms <= more for more in self._unknown):
            return False
        known = self._is_known(perfect_map(self.a, {self.storey.rooms[k].id for k in rooms}))
        (self._known if known else self._unknown).append(rooms)
        return known

    def answers(self, rooms: Rooms) -> Answers:
        """On maps with the noise of real scans, until it is clear whether most are known."""
        if rooms not in self._drawn:
            now = Answers(0, 0)
            while not now.decided(self.most):
                now = Answers(now.known + self._is_known(self._map(rooms, now.of)), now.of + 1)
            self._drawn[rooms] = now
        return self._drawn[rooms]

    def forget_perfect(self) -> None:
        """Nothing more follows from what was answered before on perfect maps."""
        self._known.clear()
        self._unknown.clear()

    def _map(self, rooms: Rooms, number: int) -> DrawnGraph:
        order = sorted(rooms)
        rng = np.random.default_rng((self.seed, self.place, number, *order))
        return draw_walk(self.storey, Walk(tuple(order), (-1,) * len(order)), "real", rng)

    def _is_known(self, drawn: DrawnGraph) -> bool:
        return bool(drawn.s_graph.wall_surfaces) and is_right(self.matcher.match(drawn.s_graph, self.a), drawn)


def is_right(result: Match, drawn: DrawnGraph) -> bool:
    """Whether the answer is unique and the true place."""
    if result.status != "unique" or result.T_a_s is None or result.floor != drawn.floor:
        return False
    ours, true, middle = np.array(result.T_a_s), np.array(drawn.T_a_s), drawn.s_graph.centroid()
    off = float(np.hypot(*(se2.apply(ours, middle) - se2.apply(true, middle))))
    return off < NEAR_M and abs(float(se2.wrap(ours[:1] - true[:1])[0])) < NEAR_RAD
