"""Room relocalisation: places a map of which only some rooms are in the known map, by matching single rooms.

Matching explains a map as a whole: rooms that the known map lacks count against every place, the true one included, and
mislead the search. A room that both runs entered is recognised by its own walls; the rest of the map must not conflict.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from data.geometry import se2
from matching.result import MatchResult
from sgslam.anchoring.free_space_conflict import conflict_share
from sgslam.anchoring.place_verification import (
    MAX_CONFLICT,
    CandidatePlace,
    candidate_places,
    has_close_alternative,
    is_clear,
    placed_at,
)
from sgslam.config import AnchorSettings

MAX_ROOMS = 5  # rooms to match, the nearest to the robot
LEAST_WALLS = 6  # surfaces of a room: with four it looks like any other
SAME = 1.0, np.radians(5)  # m and rad between the places of two rooms that agree


def relocalise_by_rooms(
    s: SceneGraph, ask: Callable[[SceneGraph], MatchResult], plan: Callable[[str | None], SceneGraph],
    settings: AnchorSettings,
) -> MatchResult | None:  # fmt: skip
    """The place that all recognised rooms of an S-graph agree on; None where there is none.

    `ask` matches a graph with the plan; `plan` as in `verified_match`. A room is recognised where its answer is clear
    and the whole S-graph has no free-space conflict there.
    """
    places: list[CandidatePlace] = []
    for room in _nearest(s):
        answer = ask(_alone(s, room))
        if not is_clear(answer):
            continue
        named = candidate_places(answer)
        share = conflict_share(s, plan(named[0].floor), named[0].T_a_s)
        if share <= MAX_CONFLICT and not has_close_alternative(named[0], named, share):
            places.append(named[0])
    if not places:
        return None
    best, middle = max(places, key=lambda place: place.score), np.array(s.centroid())
    if any(place.floor != best.floor or _differ(place.T_a_s, best.T_a_s, middle) for place in places):
        return None
    reason = f"{len(places)} rooms are recognised, one with {best.score:.0f} nats, without conflict"
    return placed_at(best, (best,), reason, s, plan(best.floor), settings)


def _nearest(s: SceneGraph) -> list[str]:
    """The ids of rooms with enough walls, the nearest to the newest keyframe first."""
    walls = [wall.room for wall in s.wall_surfaces]
    rooms = [room for room in s.rooms if walls.count(room.id) >= LEAST_WALLS]
    if s.keyframes:
        here = np.array(s.keyframes[-1].pose[:2])
        rooms.sort(key=lambda room: float(np.linalg.norm(np.array(room.centroid) - here)))
    return [room.id for room in rooms[:MAX_ROOMS]]


def _alone(s: SceneGraph, room: str) -> SceneGraph:
    return replace(
        s, rooms=(s.room_by_id[room],), wall_surfaces=tuple(w for w in s.wall_surfaces if w.room == room),
        doors=tuple(replace(door, rooms=(room,)) for door in s.doors if room in door.rooms),
    )  # fmt: skip


def _differ(T: NDArray[np.float64], other: NDArray[np.float64], middle: NDArray[np.float64]) -> bool:
    metres = np.linalg.norm(se2.apply(T, middle) - se2.apply(other, middle))
    return bool(metres > SAME[0] or np.abs(se2.wrap(T[:1] - other[:1]))[0] > SAME[1])
