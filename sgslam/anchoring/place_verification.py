"""Place verification: how clear a matcher's answer is, and which of its places a map that lacks rooms allows.

The map of an earlier run may lack the true place, and a similar part may explain most of what was seen. The matcher
scores only what it finds. Here, candidate places with free-space conflicts are dropped, and the others are judged
again.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data import LevelSurface, SceneGraph
from matching.result import Hypothesis, MatchResult
from sgslam.anchoring.free_space_conflict import conflict_share
from sgslam.anchoring.wall_association import WallArrays, associate_walls
from sgslam.config import AnchorSettings

Floats = NDArray[np.float64]
# conflict shares: of the walls that both maps could see
WITHDRAWAL_CONFLICT = 0.04  # from which on a committed place is withdrawn
MAX_CONFLICT = 0.02  # of an accepted place; a symmetric wing, equal to the centimetre, had 0.032
_DOUBTFUL = 0.01  # of a place with close alternatives; wrong places in offices of equal rooms had 0.015
CONFLICT_REASON = "the prior map contradicts that place: it has free space in place of walls, or walls in free space"
# evidence in nats
_LEAST = 40.0  # of an answer; wrong places without conflict sometimes reach it
_MIN_STRONG = 50.0  # of an answer that a larger map confirms; no wrong one did so with more evidence
_MIN_OVERWHELMING = 100.0  # of the last answer of a run; where the true place was missing, a wrong one had 80
_MIN_ALTERNATIVE = 25.0  # of another place without conflict, which may have less because less of it was mapped
_ALTERNATIVE_SHARE = 0.6  # of an answer's evidence; an alternative with more means that the building repeats itself
_DOUBTFUL_SHARE = 0.4  # the same for an answer with some conflict


@dataclass(frozen=True)
class CandidatePlace:
    """A hypothesis of a matcher: its evidence `score` (nats), T_a_s (3,), yaw x y, and its storey."""

    score: float
    T_a_s: Floats
    floor: str | None


def candidate_places(match: MatchResult) -> list[CandidatePlace]:
    """The hypotheses of a matcher's answer, in their order."""
    hypotheses = match.to_dict().get("hypotheses") or ()
    return [CandidatePlace(float(h["score"]), np.array(h["T_a_s"], dtype=float), h["floor"]) for h in hypotheses]


def is_clear(match: MatchResult) -> bool:
    """Whether an answer is unique without a close alternative."""
    alternative = max((place.score for place in candidate_places(match)[1:]), default=0.0)
    clear = alternative < _ALTERNATIVE_SHARE * evidence(match)
    return match.status == "unique" and evidence(match) >= _LEAST and clear


def is_strong(match: MatchResult) -> bool:
    """Whether an answer about a map that lacks rooms may be accepted once a larger map confirms it."""
    return match.status == "unique" and evidence(match) >= _MIN_STRONG


def is_overwhelming(match: MatchResult) -> bool:
    """Whether such an answer may be accepted without a confirmation."""
    return match.status == "unique" and evidence(match) >= _MIN_OVERWHELMING


def evidence(match: MatchResult) -> float:
    """The evidence (nats) of an answer's best hypothesis; 0 without hypotheses."""
    return max((place.score for place in candidate_places(match)), default=0.0)


def verified_match(
    match: MatchResult, s: SceneGraph, plan: Callable[[str | None], SceneGraph], settings: AnchorSettings
) -> MatchResult:
    """The answer about a map that lacks rooms, from the hypotheses of `match` that have no free-space conflict.

    `plan` gives a storey of that map, the whole map for None. Scores must be nats, as in `Hypothesis`.
    """
    places = candidate_places(match)
    judged = [(conflict_share(s, plan(p.floor), p.T_a_s), p) for p in sorted(places, key=lambda p: -p.score)]
    left = [p for share, p in judged if share <= MAX_CONFLICT]
    hypotheses = _hypotheses(left)
    if not left:
        return MatchResult("none", CONFLICT_REASON if places else match.reason)
    best = left[0]
    reason = f"{len(left)} of {len(places)} places are without conflict, the best has {best.score:.0f} nats"
    if best.score < _LEAST:
        return MatchResult("none", f"{reason}: too little, as the prior map may lack rooms", hypotheses=hypotheses)
    if len(left) > 1 and left[1].score > _MIN_ALTERNATIVE:
        return MatchResult("ambiguous", reason, hypotheses=hypotheses)
    if has_close_alternative(best, places, next(share for share, p in judged if p is best)):
        reason = f"{reason}; others are nearly as good: the building repeats itself"
        return MatchResult("ambiguous", reason, hypotheses=hypotheses)
    return placed_at(best, left, reason, s, plan(best.floor), settings)


def has_close_alternative(best: CandidatePlace, places: Sequence[CandidatePlace], conflict: float) -> bool:
    """Whether another place, with or without conflict, comes close to the best one; `conflict` is the best one's."""
    alternative = max((p.score for p in places if p is not best), default=0.0)
    return alternative > (_ALTERNATIVE_SHARE if conflict <= _DOUBTFUL else _DOUBTFUL_SHARE) * best.score


def placed_at(
    best: CandidatePlace,
    places: Sequence[CandidatePlace],
    reason: str,
    s: SceneGraph,
    a: SceneGraph,
    settings: AnchorSettings,
) -> MatchResult:
    """The unique answer that the S-graph lies at the `best` of `places`, with its walls associated by position."""
    pairs, hypotheses = _pairs(s, a, best.T_a_s, settings), _hypotheses(places)
    return MatchResult(
        "unique", reason, (), pairs, T_a_s=_triple(best.T_a_s), floor=best.floor, hypotheses=hypotheses
    )  # fmt: skip


def _hypotheses(places: Sequence[CandidatePlace]) -> tuple[Hypothesis, ...]:
    return tuple(Hypothesis(p.score, _triple(p.T_a_s), p.floor) for p in places)


def _pairs(s: SceneGraph, a: SceneGraph, T_a_s: Floats, settings: AnchorSettings) -> tuple[tuple[str, str, float], ...]:
    """(S id, A id, 1) of the wall surfaces at the same position."""
    seen, planned = list(s.wall_surfaces), list(a.wall_surfaces)
    s_rooms, a_rooms = ({room.id: k for k, room in enumerate(graph.rooms)} for graph in (s, a))
    placed = WallArrays.of(seen, s_rooms, np.zeros(2)).moved(T_a_s)
    at = associate_walls(placed, WallArrays.of(planned, a_rooms, np.zeros(2)), settings.reach, settings.gate_angle)
    return tuple((seen[i].id, planned[j].id, 1.0) for i, j in enumerate(at.tolist()) if j >= 0)


def _triple(T: Floats) -> tuple[float, float, float]:
    yaw, x, y = T.tolist()
    return yaw, x, y


class Plan:
    """An A-graph in the BIM frame. `partial`: it is the map of an earlier run and lacks rooms that were not visited.

    The factor graph uses a local frame, the BIM frame moved by `origin` (3,) into the building: a site may lie
    kilometres from zero, and priors at zero hold poorly that far away.
    """

    def __init__(self, a_graph: SceneGraph, partial: bool = False) -> None:
        self.a_graph, self.partial = a_graph, partial
        elevations = [floor.elevation for floor in a_graph.floors if floor.elevation is not None]
        self.origin: Floats = np.array([*a_graph.centroid(), min(elevations, default=0.0)])
        self._storeys: dict[str, SceneGraph] = {}

    def storey(self, storey: str | None) -> SceneGraph:
        """The A-graph of a storey by its id, always the same object; the whole A-graph for None."""
        if storey is None:
            return self.a_graph
        if storey not in self._storeys:
            self._storeys[storey] = self.a_graph.on_floor(storey)
        return self._storeys[storey]

    def height(self, storey: str | None) -> float | None:
        """Height (m) of a storey's floor in the local frame; None where the plan does not give it."""
        elevation = next((f.elevation for f in self.a_graph.floors if f.id == storey), None)
        return None if elevation is None else elevation - float(self.origin[2])

    def levels(self, storey: str | None) -> tuple[LevelSurface, ...]:
        """The level surfaces of a storey; where the plan has none, its floor at its elevation, if that is known."""
        graph = self.storey(storey)
        floor = next((f for f in self.a_graph.floors if f.id == storey), None)
        if graph.level_surfaces or floor is None or floor.elevation is None or not graph.wall_surfaces:
            return graph.level_surfaces
        ends = np.array([end for surface in graph.wall_surfaces for end in surface.ends()])
        (x0, y0), (x1, y1) = ends.min(axis=0).tolist(), ends.max(axis=0).tolist()
        corners = (x0, y0), (x1, y0), (x1, y1), (x0, y1)
        return (LevelSurface(floor.id, (0.0, 0.0, 1.0, -floor.elevation), corners, floor=storey),)

    def T_a_s(self, place: Floats) -> Floats:  # noqa: N802
        """(3,) yaw x y in the BIM frame of a place (3,) in the local frame."""
        return np.asarray(place + np.array([0.0, *self.origin[:2]]))

    def conflicts(self, s: SceneGraph, place: Floats, storey: str | None) -> bool:
        """Whether a partial plan and an S-graph at `place` (3,), T_local_level, have walls in each other's free space.

        False for a complete plan, which is not checked.
        """
        return self.partial and conflict_share(s, self.storey(storey), self.T_a_s(place)) > WITHDRAWAL_CONFLICT
