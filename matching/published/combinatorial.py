"""The search of iS-Graphs, with the parameters of the released matcher.

M. Shaheer, J. A. Millan-Romera, H. Bavle, J. L. Sanchez-Lopez, J. Civera, H. Voos: Graph-based Global Robot
Localization Informing Situational Graphs with Architectural Graphs. IROS 2023, as its public code does it.

1. Rooms: all assignments of S rooms to A rooms; of each the densest set whose distances agree (CLIPPER); the largest
   sets.
2. Walls: for each pair of rooms in them, all assignments of their walls in the same way, about the rooms' centres.
3. Combinations: every choice of wall sets for a set of rooms, scored by its mean affinity.
4. Result: the best combination and all that tie with it. One is unique, several are symmetries.

Walls are infinite planes: lengths, doors, adjacency and floors play no part. Distances and angles do not change in a
mirror, so mirror images are found too. The search is exponential in rooms and factorial in walls. It differs from the
published one as follows: random starts have a seed, rounding makes no angle undefined, an empty map gives a result,
walls without a room are paired one to one, and a rigid motion is fitted to the pairs. Earlier maps are not remembered.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from data.geometry import se2
from data.geometry.se2 import Array
from data.scene_graph import SceneGraph, WallSurface
from matching.arrays import Index
from matching.published.clipper import Deadline, Pairs, agreeing_sets, assignments
from matching.result import Hypothesis, MatchResult, Start, near_start

TIME_LIMIT_S = 60.0
LEAST_AFFINITY = 0.85  # of a wall with its room, and of a combination on average
TIE = 0.01  # solutions whose consistency differs by no more are as good as each other
MOST_COMBINATIONS = 1 << 17  # that are scored at once
ROOM_WEIGHT = 0.1  # of a centroid relative to a wall in the fit: decides only what the walls leave undetermined
LISTED = 10  # hypotheses in the result, at most


@dataclass(frozen=True)
class Gaussian:
    """exp(-x^2 / 2 sigma^2), and 0 from `bound` on."""

    sigma: float
    bound: float

    def __call__(self, x: Array) -> Array:
        return np.where(x < self.bound, np.exp(-0.5 * np.square(x / self.sigma)), 0.0)


ROOMS = Gaussian(0.1, 0.6)  # differences of the distances between rooms, metres
DISTANCES = Gaussian(0.5, 0.5)  # and between walls
ANGLES = Gaussian(0.10, 0.35)  # radians


@dataclass(frozen=True)
class Planes:
    """A graph for the search: M rooms as points, N walls as planes."""

    rooms: tuple[str, ...]
    walls: tuple[str, ...]
    place: Array  # (M, 3) metres; z is the elevation of the floor where it is given
    point: Array  # (N, 2) a point of each wall
    normal: Array  # (N, 2) unit vectors
    of_room: tuple[Index, ...]  # the walls of each room
    roomless: Index  # the walls of none

    @staticmethod
    def of(graph: SceneGraph) -> "Planes":
        """Converts a scene graph."""
        height = {f.id: f.elevation or 0.0 for f in graph.floors}
        place = [(*r.centroid, height.get(r.floor or "", 0.0)) for r in graph.rooms]
        row = {w.id: k for k, w in enumerate(graph.wall_surfaces)}
        normal = np.array([w.normal for w in graph.wall_surfaces], dtype=float).reshape(-1, 2)

        def rows(walls: Sequence[WallSurface]) -> Index:
            return np.array([row[w.id] for w in walls], dtype=np.int64)

        return Planes(
            rooms=tuple(r.id for r in graph.rooms),
            walls=tuple(row),
            place=np.array(place, dtype=float).reshape(-1, 3),
            point=np.array([w.centroid for w in graph.wall_surfaces], dtype=float).reshape(-1, 2),
            normal=normal / np.linalg.norm(normal, axis=-1, keepdims=True),  # of a map they are not quite
            of_room=tuple(rows(graph.surfaces_of_room[r.id]) for r in graph.rooms),
            roomless=rows([w for w in graph.wall_surfaces if w.room is None]),
        )

    def feet(self, walls: Index, room: int) -> Array:
        """(n, 2) the feet of the perpendiculars from a room's centre, relative to it."""
        normal = self.normal[walls]
        away = np.sum(normal * (self.point[walls] - self.place[room, :2]), axis=-1, keepdims=True)
        return np.asarray(away * normal)

    def compared(self, walls: Index, room: int) -> tuple[Array, Array]:
        """Distances (n, n) between the feet of walls, and angles (n, n) between their normals."""
        normal = self.normal[walls]
        angle = np.arccos(np.clip(normal @ normal.T, -1.0, 1.0))
        np.fill_diagonal(angle, 0.0)  # rounding, which the arccosine makes large
        return _distances(self.feet(walls, room)), angle


def _distances(points: Array) -> Array:
    return np.asarray(np.linalg.norm(points[:, None] - points[None, :], axis=-1))


@dataclass(frozen=True)
class Solution:
    """Pairs of rooms and of walls as (S, A) rows, and the mean affinity of the wall pairs with each other."""

    rooms: Pairs
    walls: Pairs
    consistency: float


class Search:
    """One search; the wall sets of a pair of rooms are computed once."""

    def __init__(self, s: Planes, a: Planes, deadline: Deadline) -> None:
        self.s, self.a, self.deadline = s, a, deadline
        self.wall_sets = cache(self._wall_sets)

    def run(self) -> list[Solution]:
        """Returns the solutions that tie. Raises TimeoutError."""
        found: list[Solution] = []
        for rooms in self.room_sets():
            sets = [self.wall_sets(r, q) for r, q in rooms]
            if all(sets):
                found += self.combined(rooms, sets)
        best = tied(found)
        if len(self.s.roomless) and len(self.a.roomless):
            best = tied([self.with_roomless(solution) for solution in best])
        return best

    def room_sets(self) -> list[Pairs]:
        """Sets of room pairs whose centres have the same distances in both graphs.

        As published, rooms closer to each other than the bound never agree.
        """
        n = len(self.s.rooms)
        ours, theirs = _distances(self.s.place), _distances(self.a.place)

        def affinity(of_a: Index) -> Array:
            of_pairs = theirs[of_a[:, :, None], of_a[:, None, :]]
            score = ROOMS(np.abs(of_pairs - ours))
            score *= (of_pairs >= ROOMS.bound) & (ours >= ROOMS.bound)
            score[:, np.arange(n), np.arange(n)] = 1.0
            return score

        return agreeing_sets(assignments(n, len(self.a.rooms)), affinity, self.deadline)

    def _wall_sets(self, r: int, q: int) -> list[Pairs]:
        """Sets of wall pairs of S room r and A room q, as rows of the graphs' walls."""
        of_s, of_a = self.s.of_room[r], self.a.of_room[q]
        if not len(of_s):
            return [()]  # a room without walls stands by its place alone
        away_s, away_a = (np.linalg.norm(x, axis=-1) for x in (self.s.feet(of_s, r), self.a.feet(of_a, q)))
        fits = DISTANCES(np.abs(away_a[:, None] - away_s[None, :])) >= LEAST_AFFINITY
        ours, theirs = self.s.compared(of_s, r), self.a.compared(of_a, q)

        def affinity(at: Index) -> Array:
            distance, angle = (x[at[:, :, None], at[:, None, :]] for x in theirs)
            return wall_affinity(ours, (distance, angle))

        found = agreeing_sets(assignments(len(of_s), len(of_a), fits), affinity, self.deadline)
        return [tuple((int(of_s[i]), int(of_a[j])) for i, j in pairs) for pairs in found]

    def combined(self, rooms: Pairs, sets: Sequence[list[Pairs]]) -> list[Solution]:
        """Returns all consistent combinations of one wall set of each room pair. Raises TimeoutError.

        The mean of a combination's affinities is computed as a sum of blocks, one for each pair of wall sets.
        """
        walls = list(dict.fromkeys(pair for options in sets for x in options for pair in x))
        row = {pair: k for k, pair in enumerate(walls)}
        member = np.zeros((sum(len(options) for options in sets), len(walls)))
        for k, x in enumerate(x for options in sets for x in options):
            member[k, [row[pair] for pair in x]] = 1.0
        affinity = self.pair_affinity(rooms[0], walls)
        np.fill_diagonal(affinity, 0.0)
        block = member @ affinity @ member.T
        sizes = [len(options) for options in sets]
        first = np.cumsum([0, *sizes[:-1]])
        number = sum(len(options[0]) for options in sets)
        found = []
        for begin in range(0, math.prod(sizes) if number > 1 else 0, MOST_COMBINATIONS):
            self.deadline.check()
            index = np.arange(begin, min(begin + MOST_COMBINATIONS, math.prod(sizes)))
            choice = np.stack(np.unravel_index(index, sizes), axis=-1) + first
            total = sum(block[choice[:, i], choice[:, j]] for i in range(len(sets)) for j in range(len(sets)))
            consistency = np.asarray(total) / (number * (number - 1))
            for at in np.nonzero(consistency >= LEAST_AFFINITY)[0]:
                pairs = tuple(walls[w] for w in np.nonzero(member[choice[at]].sum(axis=0))[0])
                found.append(Solution(rooms, pairs, float(consistency[at])))
        return found

    def pair_affinity(self, frame: tuple[int, int], pairs: Sequence[tuple[int, int]]) -> Array:
        """(n, n) of wall pairs, about the centres of a pair of rooms."""
        of_s, of_a = (np.array([p[k] for p in pairs], dtype=np.int64) for k in (0, 1))
        return wall_affinity(self.s.compared(of_s, frame[0]), self.a.compared(of_a, frame[1]))

    def with_roomless(self, solution: Solution) -> Solution:
        """Adds walls without a room where their pose relative to the first pair is as in the plan: one to one, best
        first."""
        frame, first = solution.rooms[0], solution.walls[0]
        possible = [(i, j) for i in self.s.roomless.tolist() for j in self.a.roomless.tolist()]
        affinity = np.array([self.pair_affinity(frame, (pair, first))[0, 1] for pair in possible])
        walls = list(solution.walls)
        taken: set[tuple[str, int]] = set()
        for k in np.argsort(-affinity, kind="stable").tolist():
            ends = {("s", possible[k][0]), ("a", possible[k][1])}
            if affinity[k] >= LEAST_AFFINITY and not ends & taken:
                walls.append(possible[k])
                taken |= ends
        n = len(walls)
        consistency = (self.pair_affinity(frame, walls).sum() - n) / (n * (n - 1))
        return Solution(solution.rooms, tuple(walls), float(consistency))


def wall_affinity(s: tuple[Array, Array], a: tuple[Array, Array]) -> Array:
    """(..., n, n) how similar the distances and angles of n S walls and of n A walls are."""
    return DISTANCES(np.abs(a[0] - s[0])) * ANGLES(np.abs(a[1] - s[1]))


def tied(found: list[Solution]) -> list[Solution]:
    """Returns the solutions linked to the best by a chain of consistencies at most `TIE` from each other.

    This equals DBSCAN with one sample in one dimension.
    """
    value = np.sort([m.consistency for m in found])[::-1]
    gaps = np.nonzero(-np.diff(value) > TIE)[0]
    least = value[gaps[0]] if len(gaps) else -np.inf
    return [m for m in found if m.consistency >= least]


def fitted(s: Planes, a: Planes, solution: Solution) -> tuple[float, float, float]:
    """T_a_s (yaw, x, y), the proper motion that fits a solution best.

    The rotation is the mean of the normals'; the translation moves points of walls onto their partners' lines by least
    squares.
    """
    (i, j), (r, q) = (np.array(pairs, dtype=np.int64).T for pairs in (solution.walls, solution.rooms))
    ours, theirs = (normal @ np.array([1, 1j]) for normal in (s.normal[i], a.normal[j]))
    yaw = float(np.angle(np.sum(theirs * ours.conj())))
    off = a.point[j] - se2.rotate(yaw, s.point[i])
    apart = a.place[q, :2] - se2.rotate(yaw, s.place[r, :2])
    rows = [a.normal[j], *(ROOM_WEIGHT * np.tile(axis, (len(apart), 1)) for axis in np.eye(2))]
    values = [np.sum(a.normal[j] * off, axis=-1), *(ROOM_WEIGHT * apart[:, k] for k in (0, 1))]
    x, y = np.linalg.lstsq(np.concatenate(rows), np.concatenate(values), rcond=None)[0].tolist()
    return yaw, x, y


class CombinatorialMatcher:
    """Matches by exhaustive search."""

    def match(
        self, s: SceneGraph, a: SceneGraph, *, floor: str | None = None, start: Start | None = None
    ) -> MatchResult:
        """See `Matcher.match`. Confidences are the solution's consistency divided by the number of solutions: of
        several, the first found is as good as any."""
        began = time.perf_counter()
        plan = a if floor is None else a.on_floor(floor)
        for what, empty in (("S-graph", not s.rooms), ("A-graph", not plan.rooms)):
            if empty:
                return MatchResult("none", f"the {what} has no room")
        ours, theirs = Planes.of(s), Planes.of(plan)
        reason = "no set of rooms and walls agrees with the plan"
        try:
            solutions = Search(ours, theirs, Deadline(began + TIME_LIMIT_S)).run()
        except TimeoutError:
            solutions, reason = [], f"the search did not end within {TIME_LIMIT_S:g} s"
        found = [(m, fitted(ours, theirs, m)) for m in solutions]
        if start is not None:
            found = [(m, T) for m, T in found if near_start(start, np.array(T))]
        if not found:
            return MatchResult("none", reason, seconds=time.perf_counter() - began)
        hypotheses = []
        for m, T_a_s in found[:LISTED]:
            rooms = tuple((ours.rooms[r], theirs.rooms[q]) for r, q in m.rooms)
            hypotheses.append(Hypothesis(m.consistency, T_a_s, plan.room_by_id[rooms[0][1]].floor, rooms))
        best, confidence = found[0][0], min(found[0][0].consistency, 1.0) / len(found)
        return MatchResult(
            status="unique" if len(found) == 1 else "ambiguous",
            reason="one solution" if len(found) == 1 else f"{len(found)} solutions are as good as each other",
            rooms=tuple((ours.rooms[r], theirs.rooms[q], confidence) for r, q in best.rooms),
            wall_surfaces=tuple((ours.walls[i], theirs.walls[j], confidence) for i, j in best.walls),
            T_a_s=hypotheses[0].T_a_s,
            floor=hypotheses[0].floor,
            hypotheses=tuple(hypotheses),
            seconds=time.perf_counter() - began,
        )
