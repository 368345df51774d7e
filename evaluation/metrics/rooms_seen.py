"""The rooms that a run has seen, and the number that the matching benchmark needs from the same start room."""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from data import SceneGraph
from data.synthetic_maps.exploration import Storey, storeys_of, walk
from data.synthetic_maps.noise_models import draw_walk
from evaluation.metrics.maps import wall_scores
from matching.ambiguity.match_cache import is_correct
from matching.protocol import AnyMatcher

Array = NDArray[np.float64]
MOST_ASKED = 9  # largest number of rooms that is tried
PAIRS = 5  # maps drawn for each number of rooms; most of them must be matched
SURE_PAIRS, MISSED = 40, 2  # maps drawn for the 95 % criterion, and how many of them may fail
LEAST_SEEN = 0.5  # share of a room's walls, by length


def rooms_entered(floor: SceneGraph, places: Array) -> list[str]:
    """The rooms of a storey that a path through `places` (N, 2 or 3) enters, in order."""
    if not len(places):
        return []
    inside = {
        room.id: np.flatnonzero(shapely.contains_xy(shapely.Polygon(room.polygon), places[:, 0], places[:, 1]))
        for room in floor.rooms if len(room.polygon or ()) > 2
    }  # fmt: skip
    return sorted((room for room, at in inside.items() if len(at)), key=lambda room: int(inside[room][0]))


def rooms_seen(s_graph: SceneGraph, floor: SceneGraph, T_bim_map: Array, places: Array) -> set[str]:
    """The rooms of a storey that were entered or most of whose walls are in the S-graph at `T_bim_map` (4, 4)."""
    missed = set(wall_scores(s_graph, floor, T_bim_map).missed)
    seen = set(rooms_entered(floor, places))
    for room, walls in floor.surfaces_of_room.items():
        length = sum(w.length or 0.0 for w in walls)
        if length > 0 and sum(w.length or 0.0 for w in walls if w.id not in missed) > LEAST_SEEN * length:
            seen.add(room)
    return seen


@dataclass(frozen=True)
class RoomsNeeded:
    """The smallest number of rooms at which most maps are matched, and at which 95 % are; None if none is enough."""

    most: int | None = None
    sure: int | None = None


def rooms_needed(a_graph: SceneGraph, room: str, matcher: AnyMatcher) -> RoomsNeeded:
    """The number of rooms, from `room` on, that the matcher needs for a unique and correct match of the matching
    benchmark's maps (regime `real`, rooms in any order); empty for a room without walls in the plan."""
    for storey in storeys_of(a_graph):
        start = next((k for k, r in enumerate(storey.rooms) if r.id == room), None)
        if start is not None:
            return _needed(a_graph, storey, start, matcher)
    return RoomsNeeded()


def _needed(a_graph: SceneGraph, storey: Storey, start: int, matcher: AnyMatcher) -> RoomsNeeded:
    most = None
    for count in range(1, min(MOST_ASKED, len(storey.rooms)) + 1):
        known: list[bool] = []
        while len(known) < PAIRS or (len(known) < SURE_PAIRS and known.count(False) <= MISSED):
            rng = np.random.default_rng((0, start, count, len(known)))
            drawn = draw_walk(storey, walk(storey, rng, count, start), "real", rng)
            known.append(bool(drawn.s_graph.wall_surfaces) and is_correct(matcher.match(drawn.s_graph, a_graph), drawn))
        if most is None and 2 * sum(known[:PAIRS]) > PAIRS:
            most = count
        if known.count(False) <= MISSED:
            return RoomsNeeded(most, count)
    return RoomsNeeded(most)
