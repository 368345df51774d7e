"""Matching one floor of the S-graph: what the matcher is asked, its newest answer, and whether to commit to it."""

import logging
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from data.scene_graph.motion import mirrored
from matching.result import AnyMatcher, MatchResult
from sgslam.anchoring.match_history import MapSize, UniqueMatch
from sgslam.anchoring.place_verification import (
    CONFLICT_REASON,
    Plan,
    candidate_places,
    evidence,
    is_clear,
    is_overwhelming,
    is_strong,
    verified_match,
)
from sgslam.anchoring.room_relocalisation import relocalise_by_rooms
from sgslam.anchoring.wall_alignment import place_from_match
from sgslam.config import AnchorSettings
from sgslam.mapping import Scene, WallMap
from sgslam.serialization import Stateful

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
_APART = 1.0, np.radians(5)  # m and rad from which on two answers place the map differently
_MIRRORED = 3.0  # nats: a map is rarely the mirror image of a building, and nearly symmetric buildings are not rare
MIRRORED_REASON = (
    "the mirror image of the map fits the plan better: are the scans mirrored? A sensor that is upside down needs "
    "--mount 180,0,0; leave it out for one that is upright"
)
_NEARLY = 0.88  # of the best place's evidence, that of another place, from which on they are nearly equal
STOREY_REASON = "storey '{}' of the plan explains the map better than the one that was given; check --storey"
NEARLY_REASON = (
    "another place explains the map nearly as well: only small deviations of the building from its plan tell them apart"
)
_SEVERAL = 8  # matched wall surfaces, about two rooms', for an answer to confirm a later one


@dataclass(frozen=True)
class PlacedMatch:
    """A unique answer with the place (3,), T_local_level, that its walls agree on; `by_room`: found room by room."""

    match: MatchResult
    place: Floats
    by_room: bool


class FloorMatching(Stateful):
    """Asks the matcher about one floor and remembers its answers.

    `match` is the newest answer, `scene` the map it is about, `rejection` the reason why it was not accepted though
    unique. Only `storey` is matched where that is known; answers outside `possible_storeys` are rejected, unless that
    list is empty.
    """

    _STATE = (
        "storey", "possible_storeys", "match", "scene", "rejection", "count", "_size", "_last_unique",
    )  # fmt: skip

    def __init__(self, plan: Plan, matcher: AnyMatcher, settings: AnchorSettings) -> None:
        self._plan, self._matcher, self._settings = plan, matcher, settings
        self._is_given = False  # whether the storey follows from a statement of the user
        self.storey: str | None = None
        self.possible_storeys: list[str] = []
        self.match: MatchResult | None = None
        self.scene: Scene | None = None
        self.rejection = ""
        self.count = 0
        self._size = MapSize()  # of the map when the matcher was last due
        self._last_unique: UniqueMatch | None = None

    @property
    def is_unique(self) -> bool:
        """Whether the newest answer is unique and was not rejected."""
        return self.match is not None and self.match.status == "unique" and not self.rejection

    def restrict_storeys(self, storeys: list[str], known: str | None) -> None:
        """Sets the storeys that this floor can be, all where the list is empty, and the only one to match if known."""
        self.possible_storeys = storeys
        self._is_given = known is not None
        self.storey = known or self.storey

    def match_only(self, storey: str) -> None:
        """Matches only this storey from now on, beginning with the next update."""
        self.storey, self._size = storey, MapSize()

    def take_over(self, match: MatchResult, scene: Scene, storey: str) -> None:
        """Makes an answer that follows from other floors the newest one."""
        self.match, self.scene, self.storey = match, scene, storey

    def is_due(self, graph: SceneGraph, committed: bool) -> bool:
        """Whether the map has grown enough to be matched again.

        Also true where no match is committed to and a unique answer from a smaller map can now be confirmed.
        """
        if MapSize.of(graph).has_grown_since(self._size):
            return True
        earlier = self._last_unique
        if committed or self._plan.partial or not self.is_unique or earlier is None:
            return False
        return earlier.is_confirmable(len(graph.keyframes))

    def note_size(self, graph: SceneGraph) -> None:
        """Records the size of the map where it has grown, so that the next match waits for further growth."""
        size = MapSize.of(graph)
        if size.has_grown_since(self._size):
            self._size = size

    def ask(self, scene: Scene, walls: WallMap, relocalise: bool) -> PlacedMatch | None:
        """Matches the floor with the plan; None where the answer is not unique or is rejected.

        With `relocalise`, single rooms are matched with a partial plan where the whole floor has no unique answer.
        """
        self.rejection = ""
        s, plan, settings, by_room = scene.graph, self._plan.storey(self.storey), self._settings, None
        match = self._matcher.match(s, plan)
        if self._plan.partial:
            match = verified_match(match, s, self._plan.storey, settings)
            if match.status != "unique" and relocalise:
                by_room = relocalise_by_rooms(s, lambda p: self._matcher.match(p, plan), self._plan.storey, settings)
        self.match = match = by_room or match
        self.scene = scene
        self.count += 1
        _log.info("match %d, of %d rooms: %s, %s", self.count, len(s.rooms), match.status, match.reason)
        place = self._verified_place(match, scene, walls) if match.status == "unique" else None
        if place is not None and (
            self.reject_nearly_equal(scene)
            or self.reject_given_storey(scene)
            or (relocalise and self.reject_mirrored(scene))
        ):
            place = None
        if place is None:
            self._last_unique = None if self._plan.partial else self._last_unique
            return None
        return PlacedMatch(match, place, by_room is not None)

    def reject_nearly_equal(self, scene: Scene) -> bool:
        """Rejects the newest answer if another place has nearly its evidence; returns whether one has.

        Two equal offices differ by the scatter of many walls as they are built. A matcher that takes the walls for
        independent trusts that too much: a wrong office had 17 nats more than the true one, of 122.
        """
        places = [] if self._plan.partial or self.match is None else candidate_places(self.match)
        near = [p for p in places if p.score > _NEARLY * places[0].score]
        if all(p.floor == near[0].floor and not differ(p.T_a_s, near[0].T_a_s, scene) for p in near[1:]):
            return False
        self.rejection = NEARLY_REASON
        _log.info("match %d is rejected: %s", self.count, self.rejection)
        return True

    def reject_given_storey(self, scene: Scene) -> bool:
        """Rejects the newest answer if another storey than the given one explains the map better; returns whether one
        does. Storeys that are nearly alike leave it to the user."""
        if not self._is_given or self.match is None:
            return False
        anywhere = self._matcher.match(scene.graph, self._plan.a_graph)
        if anywhere.status == "none" or not (places := candidate_places(anywhere)):
            return False
        best = max(places, key=lambda place: place.score)
        if best.floor in (None, self.storey) or evidence(self.match) >= _NEARLY * best.score:
            return False
        names = {floor.id: floor.name for floor in self._plan.a_graph.floors}
        self.rejection = STOREY_REASON.format(names.get(best.floor) or best.floor)
        _log.info("match %d is rejected: %s", self.count, self.rejection)
        return True

    def reject_mirrored(self, scene: Scene) -> bool:
        """Rejects the newest answer if the mirror image of the map fits the plan better; returns whether it does."""
        image = self._matcher.match(mirrored(scene.graph), self._plan.storey(self.storey))
        found = 0.0 if self.match is None else evidence(self.match)
        if image.status != "unique" or evidence(image) <= found + _MIRRORED:
            return False
        self.rejection = MIRRORED_REASON
        _log.info("match %d is rejected: %s", self.count, self.rejection)
        return True

    def is_sure(self, answer: PlacedMatch, scene: Scene, last: bool) -> bool:
        """Whether the newest answer may be committed to; remembers it for the next time.

        It may if a smaller map gave the same answer, if it is clear, or if it is the `last` one of the run. With a
        partial plan only a last answer of overwhelming evidence needs no confirmation.
        """
        confirmed = self._is_confirmed(answer, scene)
        if not self._plan.partial:
            return confirmed or is_clear(answer.match) or last
        sufficient = is_strong if answer.by_room else is_overwhelming
        return confirmed or (sufficient(answer.match) and last)

    def _is_confirmed(self, answer: PlacedMatch, scene: Scene) -> bool:
        """Whether a smaller map gave the same answer."""
        match, place, keyframes = answer.match, answer.place, len(scene.graph.keyframes)
        now = UniqueMatch(match.floor, place, evidence(match), MapSize.of(scene.graph), keyframes)
        earlier = self._last_unique
        same = earlier is not None and earlier.floor == match.floor and not differ(place, earlier.place, scene)
        first = replace(earlier, place=place) if earlier is not None and same else now
        several = len(match.wall_surfaces) >= min(_SEVERAL, len(self._plan.storey(match.floor).wall_surfaces))
        self._last_unique = first if several else None
        if answer.by_room:  # further rooms add no evidence to it
            return same and now.map_size.has_grown_since(first.map_size)
        if self._plan.partial:
            return same and is_strong(match) and now.has_more_evidence_than(first)
        return same and first.is_confirmable(keyframes)

    def _verified_place(self, match: MatchResult, scene: Scene, walls: WallMap) -> Floats | None:
        """The place (3,), T_local_level, that most matched walls agree on; None if the answer is rejected."""
        assert match.T_a_s is not None  # a unique answer has a motion
        place, origin = None, self._plan.origin[:2]
        if self.possible_storeys and match.floor not in self.possible_storeys:
            self.rejection = "the height between the floors rules out its storey"
        else:
            a = self._plan.a_graph
            pairs = [(scene.graph.surface_by_id[s], a.surface_by_id[a_id]) for s, a_id, _ in match.wall_surfaces]
            rough = np.array(match.T_a_s) - np.array([0.0, *origin])
            place = place_from_match(pairs, scene, walls, origin, rough, self._settings)
            if place is None:
                self.rejection = "its walls do not agree on a place"
            elif self._plan.conflicts(scene.graph, place, match.floor):
                self.rejection, place = CONFLICT_REASON, None
        if place is None:
            _log.info("match %d is rejected: %s", self.count, self.rejection)
        return place


def differ(place: Floats, other: Floats, scene: Scene, metres: float = _APART[0]) -> bool:
    """Whether two places (3,) differ by more than `metres` at the centroid of the map, or by five degrees."""
    c, s = np.cos([place[0], other[0]]), np.sin([place[0], other[0]])
    x, y = scene.graph.centroid()
    put = np.column_stack([c * x - s * y, s * x + c * y]) + np.stack([place[1:], other[1:]])
    turn = (place[0] - other[0] + np.pi) % (2 * np.pi) - np.pi
    return bool(np.hypot(*(put[0] - put[1])) > metres or abs(turn) > _APART[1])
