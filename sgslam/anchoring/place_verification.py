"""What an answer of the matcher is worth: how clear it is, and which of its places a map that lacks rooms leaves.

In a map that was driven the true place may be missing, and a place in a part that is like it explains most of what was
seen. The matcher weighs what it finds; here also counts what ought to be there: places where walls stand in what the
other map saw free are struck out, and what is left is judged anew.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from matching.result import Hypothesis, MatchResult
from sgslam.anchoring.free_space_conflict import conflict_share
from sgslam.anchoring.matcher_protocol import Match
from sgslam.anchoring.wall_association import WallArrays, associate_walls
from sgslam.config import AnchorSettings

Floats = NDArray[np.float64]
WITHDRAWAL_CONFLICT = 0.04  # of the walls where both maps looked, by which a place is given up that was committed to,
MAX_CONFLICT = 0.02  # and by which none is taken: a wing that is another one's twin, to the centimetre, had .032
_DOUBTFUL = 0.01  # and by which none is that another comes near: in offices of equal rooms wrong ones had .015
CONFLICT_REASON = "walls stand where the known map saw none, or lack where it has them"
_LEAST = 40.0  # nats of an answer; wrong places that contradict nothing reach it now and then,
_MIN_STRONG = 50.0  # of one that a larger map bears out; none of those did with the evidence risen,
_MIN_OVERWHELMING = 100.0  # and of one that is the last; where the true place was lacking, a wrong one had 80
_MIN_ALTERNATIVE = 25.0  # of another place that contradicts nothing: it has less only because less of it was mapped
_ALTERNATIVE_SHARE = 0.6  # of an answer's evidence; where another place has more, the building repeats itself
_NEAR = 0.4  # likewise, of an answer that is conflict_share somewhat


@dataclass(frozen=True)
class CandidatePlace:
    """A place that a matcher names: its evidence (nats), T_a_s (3,) yaw x y, and its storey."""

    score: float
    T_a_s: Floats
    floor: str | None


def candidate_places(match: Match) -> list[CandidatePlace]:
    """The places that a matcher has named, as it did; none where it names none."""
    told = match.to_dict().get("hypotheses") or ()
    return [CandidatePlace(float(h["score"]), np.array(h["T_a_s"], dtype=float), h["floor"]) for h in told]


def is_clear(match: Match) -> bool:
    """Whether an answer is unique, and no other place comes near it."""
    rival = max((place.score for place in candidate_places(match)[1:]), default=0.0)
    return match.status == "unique" and evidence(match) >= _LEAST and rival < _ALTERNATIVE_SHARE * evidence(match)


def is_strong(match: Match) -> bool:
    """Whether an answer about a map that lacks rooms is to be believed when a larger map bears it out."""
    return match.status == "unique" and evidence(match) >= _MIN_STRONG


def is_overwhelming(match: Match) -> bool:
    """Whether such an answer is to be believed where no larger map will come."""
    return match.status == "unique" and evidence(match) >= _MIN_OVERWHELMING


def evidence(match: Match) -> float:
    """(nats) of an answer's best place; 0 where the matcher names none."""
    return max((place.score for place in candidate_places(match)), default=0.0)


def verified_match(
    match: Match, s: SceneGraph, plan: Callable[[str | None], SceneGraph], settings: AnchorSettings
) -> MatchResult:
    """The answer about a map that lacks rooms, from the places that `match` names and the two maps bear out.

    `plan` gives a storey of that map, the whole for None. The scores have to be nats, as `Hypothesis` has them.
    """
    places = candidate_places(match)
    judged = [(conflict_share(s, plan(p.floor), p.T_a_s), p) for p in sorted(places, key=lambda p: -p.score)]
    left = [p for share, p in judged if share <= MAX_CONFLICT]
    hypotheses = _hypotheses(left)
    if not left:
        return MatchResult("none", CONFLICT_REASON if places else match.reason)
    best = left[0]
    told = f"{len(left)} of {len(places)} places contradict nothing, the best has {best.score:.0f} nats"
    if best.score < _LEAST:
        return MatchResult("none", f"{told}: too little where the known map may lack rooms", hypotheses=hypotheses)
    if len(left) > 1 and left[1].score > _MIN_ALTERNATIVE:
        return MatchResult("ambiguous", told, hypotheses=hypotheses)
    if has_close_alternative(best, places, next(share for share, p in judged if p is best)):
        told = f"{told}; others come near it: the building repeats itself"
        return MatchResult("ambiguous", told, hypotheses=hypotheses)
    return placed_at(best, left, told, s, plan(best.floor), settings)


def has_close_alternative(best: CandidatePlace, places: Sequence[CandidatePlace], contradiction: float) -> bool:
    """Whether another of the places comes near the best one, the other conflict_share or not; `contradiction` is the
    best one's own."""
    rival = max((p.score for p in places if p is not best), default=0.0)
    return rival > (_ALTERNATIVE_SHARE if contradiction <= _DOUBTFUL else _NEAR) * best.score


def placed_at(
    best: CandidatePlace,
    places: Sequence[CandidatePlace],
    told: str,
    s: SceneGraph,
    a: SceneGraph,
    settings: AnchorSettings,
) -> MatchResult:
    """The unique answer that the S-graph lies at the `best` of some places, its walls paired as they stand there."""
    pairs, hypotheses = _pairs(s, a, best.T_a_s, settings), _hypotheses(places)
    return MatchResult(
        "unique", told, (), pairs, T_a_s=_triple(best.T_a_s), floor=best.floor, hypotheses=hypotheses
    )  # fmt: skip


def _hypotheses(places: Sequence[CandidatePlace]) -> tuple[Hypothesis, ...]:
    return tuple(Hypothesis(p.score, _triple(p.T_a_s), p.floor) for p in places)


def _pairs(s: SceneGraph, a: SceneGraph, T_a_s: Floats, settings: AnchorSettings) -> tuple[tuple[str, str, float], ...]:
    """(S id, A id, 1) of the wall surfaces that stand at one another."""
    seen, planned = list(s.wall_surfaces), list(a.wall_surfaces)
    s_rooms, a_rooms = ({room.id: k for k, room in enumerate(graph.rooms)} for graph in (s, a))
    placed = WallArrays.of(seen, s_rooms, np.zeros(2)).moved(T_a_s)
    at = associate_walls(placed, WallArrays.of(planned, a_rooms, np.zeros(2)), settings.reach, settings.gate_angle)
    return tuple((seen[i].id, planned[j].id, 1.0) for i, j in enumerate(at.tolist()) if j >= 0)


def _triple(T: Floats) -> tuple[float, float, float]:
    yaw, x, y = T.tolist()
    return yaw, x, y
