"""The combinatorial search of iS-Graphs, the published way to find an S-graph in an A-graph without learning.

M. Shaheer, J. A. Millan-Romera, H. Bavle, J. L. Sanchez-Lopez, J. Civera, H. Voos: Graph-based Global Robot
Localization Informing Situational Graphs with Architectural Graphs. IROS 2023, as its public code does it.

1. Rooms: all injections of S rooms into A rooms; of each the densest set whose distances agree; the largest sets.
2. Walls: for each pair of rooms in them, all injections of their walls in the same way, about the rooms' centres.
3. Combinations: every choice of wall sets for a set of rooms, scored by its mean affinity.
4. Result: the best combination and all that tie with it. One is unique, several are symmetries.

Distances and angles do not change in a mirror, so mirror images are found too. The search is exponential in rooms and
factorial in walls. It differs from the published one as follows: random starts have a seed, rounding makes no angle
undefined, an empty map gives a result, walls without a room are paired one to one, and a rigid motion is fitted to the
pairs. Earlier maps are not remembered. Where walls may be left out, only solutions with the most walls tie, which the
publication leaves open.
"""

import time
from dataclasses import dataclass

import numpy as np

from data.scene_graph import SceneGraph
from matching.arrays import Index
from matching.combinatorial.affinity import Compared, Datums, fits_room, room_affinity, wall_affinity
from matching.combinatorial.answer import answer, fitted
from matching.combinatorial.merge import Merged, merged, tied, with_left_over, with_roomless
from matching.combinatorial.sets import AgreeingSet, Clock, Pairs, TimeIsUpError, agreeing_sets, injections
from matching.combinatorial.settings import DEVELOP, CombinatorialSettings
from matching.result import MatchResult
from matching.search import Start, near_start


@dataclass(frozen=True)
class CombinatorialMatcher:
    """Matches by exhaustive search. `settings` are DEVELOP (the released matcher) or GRID (the later branch)."""

    settings: CombinatorialSettings = DEVELOP

    def match(
        self, s: SceneGraph, a: SceneGraph, *, floor: str | None = None, start: Start | None = None
    ) -> MatchResult:
        """See `Matcher.match`. Confidences are the solution's consistency divided by the number of solutions."""
        clock = Clock(time.perf_counter(), self.settings.limit_s)
        planned = a if floor is None else a.on_floor(floor)
        for what, empty in (("S-graph", not s.rooms), ("A-graph", not planned.rooms)):
            if empty:
                return MatchResult("none", f"the {what} has no room")
        search = Search(Datums.of(s, self.settings), Datums.of(planned, self.settings), self.settings, clock)
        try:
            solutions = search.run()
        except TimeIsUpError:
            reason = f"the search did not end within {self.settings.limit_s:g} s"
            return MatchResult("none", reason, seconds=time.perf_counter() - clock.began)
        motions = [fitted(search.s, search.a, m) for m in solutions]
        near = [k for k, T in enumerate(motions) if start is None or near_start(start, T)]
        solutions, motions = [solutions[k] for k in near], [motions[k] for k in near]
        return answer(search.s, search.a, planned, solutions, motions, time.perf_counter() - clock.began)


class Search:
    """One search; results for pairs of rooms are cached."""

    def __init__(self, s: Datums, a: Datums, settings: CombinatorialSettings, clock: Clock) -> None:
        self.s, self.a, self.settings, self.clock = s, a, settings, clock
        self._wall_sets: dict[tuple[int, int], list[AgreeingSet]] = {}

    def run(self) -> list[Merged]:
        """Returns the solutions that tie. Raises TimeIsUpError."""
        found: list[Merged] = []
        for rooms in self.room_sets():
            sets = [self.wall_sets(r, q) for r, q in rooms]
            if all(sets):
                found += merged(self.s, self.a, self.settings, rooms, sets, self.clock)
        if self.settings.partial_walls:  # a few walls would tie with many
            most = max((len(m.walls) for m in found), default=0)
            found = [m for m in found if len(m.walls) == most]
        best = tied(found, self.settings.tie)
        if len(self.s.roomless) and len(self.a.roomless):
            best = tied([with_roomless(self.s, self.a, self.settings, m) for m in best], self.settings.tie)
        return [with_left_over(self.s, self.a, self.settings, m) for m in best]

    def room_sets(self) -> list[Pairs]:
        """Sets of room pairs whose centres have the same distances in both graphs."""
        s, a = Compared.of_points(self.s.place), Compared.of_points(self.a.place)
        found = agreeing_sets(
            injections(len(self.s.rooms), len(self.a.rooms)), lambda of_a: room_affinity(self.settings, s, a, of_a),
            self.settings.least_rooms, self.settings.restarts, self.clock,
        )  # fmt: skip
        return [x.pairs for x in found]

    def wall_sets(self, r: int, q: int) -> list[AgreeingSet]:
        """Sets of wall pairs of S room r and A room q, as rows of the graphs' walls."""
        if (r, q) not in self._wall_sets:
            self._wall_sets[r, q] = self._searched(r, q, self.s.of_room[r], self.a.of_room[q])
        return self._wall_sets[r, q]

    def _searched(self, r: int, q: int, of_s: Index, of_a: Index) -> list[AgreeingSet]:
        if not len(of_s):
            return [AgreeingSet((), 1.0)]  # a room without walls stands by its place alone
        fits = fits_room(self.settings, self.s.feet(of_s, r), self.a.feet(of_a, q))
        s, a = Compared.of_walls(self.s, of_s, r), Compared.of_walls(self.a, of_a, q)
        every, planes = np.arange(len(of_s)), self.settings.planes
        found = agreeing_sets(
            injections(len(of_s), len(of_a), fits, self.settings.partial_walls),
            lambda at: wall_affinity(planes, s, a, np.broadcast_to(every, at.shape), at),
            self.settings.least_walls, self.settings.restarts, self.clock,
        )  # fmt: skip
        return [AgreeingSet(tuple((int(of_s[i]), int(of_a[j])) for i, j in x.pairs), x.score) for x in found]
