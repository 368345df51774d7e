"""When a floor of the S-graph is matched, what of a match becomes an anchor, and when an anchor is withdrawn."""

import logging
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import factors
from data import SceneGraph, WallSurface
from matching.result import MatchResult
from sgslam.anchoring.anchor_log import AnchorLog, AnchorStatus, Key
from sgslam.anchoring.anchored_rooms import matched_rooms, room_anchors
from sgslam.anchoring.free_space_conflict import conflict_share
from sgslam.anchoring.match_history import MapSize, UniqueMatch
from sgslam.anchoring.matcher_protocol import AnyMatcher, Match
from sgslam.anchoring.place_verification import (
    CONFLICT_REASON,
    WITHDRAWAL_CONFLICT,
    evidence,
    is_clear,
    is_overwhelming,
    is_strong,
    verified_match,
)
from sgslam.anchoring.room_relocalisation import relocalise_by_rooms
from sgslam.anchoring.wall_alignment import WallAlignment, align_walls, place_from_match, planar_pose
from sgslam.backend.backend import Anchors, PlannedWall
from sgslam.config import Config
from sgslam.geometry.frames import inverse, se2_to_se3, transform_points
from sgslam.mapping.scene import Scene
from sgslam.mapping.wall_map import WallMap
from sgslam.serialization.state_tree import Stateful

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
_STAYS = 2.0  # of the gate; a wall that is off by more though it was pulled
_LEAST_HELD = 4  # walls as planned, for a floor to take over another one's place
_APART = 1.0, np.radians(5)  # m and rad at which two answers place the map differently
_SEVERAL = 8  # wall surfaces matched, about two rooms', by which an answer counts for the next one


class FloorAnchoring(Stateful):
    """Keeps the answer of the matcher for floor `number` of the S-graph, and turns a unique one into anchors.

    `a_graph` in the BIM frame; inside, a local frame is used (the BIM's, moved by `origin` (3,) into the building),
    because a site may lie kilometres from zero, and what is aligned at zero is aligned loosely far from it. `plan` gives the
    A-graph of a storey, the whole one for None. A `partial` plan is a map of a run: where the robot is now, that run
    need not have been, so that answers are judged anew (see `verified_match`).
    """

    _STATE = (
        "match", "committed", "_pairs", "_drift_candidates", "_confirmed_deviations", "_place", "_matched_scene", "_matched_size", "_match_count",
        "_replaced", "_storey_to_match", "_possible_storeys", "follows", "_confidence", "_last_unique", "rejection",
        "_conflict_checked_at",
    )  # fmt: skip

    def __init__(
        self, a_graph: SceneGraph, matcher: AnyMatcher, config: Config, origin: Floats,
        plan: Callable[[str | None], SceneGraph], number: int = 0, partial: bool = False,
    ) -> None:  # fmt: skip
        self._a, self._matcher, self._config, self._plan = a_graph, matcher, config, plan
        self.origin, self.number, self._partial = origin, number, partial
        self.rejection = ""  # why the newest answer, though unique, was not committed to
        self._conflict_checked_at = 0  # of the map that was last aligned against a partial plan
        self._storey_to_match: str | None = (
            None  # the storey that the matcher is asked about; all of them, where it is None
        )
        self._possible_storeys: list[str] = []  # the storeys that this floor can be, all where it is empty
        self._confidence = 0.0  # of a commitment that follows another one
        self.follows = False  # whether the commitment is that of another floor
        self.match: Match | None = None  # the newest answer
        self.committed: Match | None = None  # the answer that the anchors stand on
        self.log = AnchorLog()
        self._pairs: set[Key] = set()  # of the committed answer
        self._drift_candidates: set[Key] = (
            set()
        )  # that were aligned tight though off, since the map seemed drifted there
        self._confirmed_deviations: set[Key] = set()  # that were pulled, and did not come
        self._place = np.zeros(3)  # T_local_level of the committed answer, yaw x y
        self._matched_scene: Scene | None = None  # what the newest answer is about
        self._matched_size = MapSize()
        self._match_count = 0
        self._replaced = False  # what the back end says is of a place that was withdrawn
        self._last_unique: UniqueMatch | None = None  # the newest unique answer

    def state(self) -> dict[str, Any]:
        """See `Stateful`; with its log's."""
        return {**super().state(), "log": self.log.state()}

    def restore(self, state: dict[str, Any]) -> None:
        """See `Stateful`."""
        super().restore(state)
        self.log.restore(state["log"])

    def update(self, scene: Scene, walls: WallMap, T_map_local: Floats | None, last: bool) -> Anchors | None:
        """Returns the anchors that hold now.

        Where there are none, the matcher is asked if the S-graph has grown enough (or it is the `last` time). Where
        there are, walls are paired by position, and the matcher is asked again only where too few stand as planned.
        `T_map_local` is the back end's estimate of the BIM's local frame where there is one.
        """
        self.log.rename(walls.current)
        for keys in (self._pairs, self._drift_candidates, self._confirmed_deviations):
            renamed = {(walls.current(wall), a_id) for wall, a_id in keys}
            keys.clear()
            keys.update(renamed)
        map_size = MapSize.of(scene.graph)
        keyframes = len(scene.graph.keyframes)
        if self._partial and self.committed is not None and keyframes > self._conflict_checked_at:
            self._conflict_checked_at = keyframes
            if self._conflicts(scene, self._known(walls, T_map_local), self.committed.floor):
                self._withdraw(scene, CONFLICT_REASON)
        alignment = self._alignment_after_pull(scene, walls, T_map_local)
        share = 0.0 if alignment is None else alignment.share
        asked = (
            last
            or map_size.has_grown_since(self._matched_size)
            or (self.committed is None and self._confirmation_due(scene))
        )
        if asked and share < self._config.anchors.least_share:
            before = self.committed
            self._match(scene, walls, T_map_local, last)
            if before is not None and self.committed is before and alignment is None:
                self._withdraw(scene, "the walls no longer agree on a place in the plan")
            alignment = self.alignment(scene, walls, T_map_local)
        if map_size.has_grown_since(self._matched_size):
            self._matched_size = map_size
        if alignment is None:
            return None
        self._drift_candidates = {
            (scene.wall_of_surface[h.surface.id], h.planned.id) for h in alignment.walls if h.drifted
        }
        holds = self._log_anchors(scene, alignment)
        anchors = self._anchors(scene, walls, alignment, T_map_local, holds)
        self._replaced = False
        return anchors

    def confirm(self, scene: Scene, walls: WallMap, T_map_local: Floats | None) -> bool:
        """Whether the matcher, with the whole building open to it, says of `scene` what was committed to.

        Where it does not, the commitment is withdrawn; to a partial plan only where the maps contradict each other, for
        much of the map may lie beside it. True where there was none.
        """
        if self.committed is None:
            self._match(scene, walls, None, last=True)
            return True
        self._match(scene, walls, T_map_local, last=True)
        if self.committed is self.match:
            return not self._replaced
        if self._partial and not self._conflicts(scene, self._known(walls, T_map_local), self.committed.floor):
            return True
        assert self.match is not None
        self._withdraw(scene, self.match.reason)
        return False

    def _confirmation_due(self, scene: Scene) -> bool:
        """Whether a smaller map had a unique answer, which a second one is to confirm even if it has grown little."""
        earlier = self._last_unique
        return (
            self._unique
            and not self._partial
            and earlier is not None
            and earlier.is_confirmable(len(scene.graph.keyframes))
        )

    @property
    def _unique(self) -> bool:
        return self.match is not None and self.match.status == "unique" and not self.rejection

    @property
    def awaits_confirmation(self) -> bool:
        """Whether there is an answer about a partial plan that waits only for a larger map to say the same."""
        return self._partial and self.committed is None and self._unique

    def restrict_storeys(self, storeys: list[str], asked: str | None) -> None:
        """The storeys that this floor can be (all, where there are none), and the one that the matcher is asked about
        from now on, where that is known."""
        self._possible_storeys = storeys
        self._storey_to_match = asked or self._storey_to_match

    def match_only(self, storey: str) -> None:
        """From now on the matcher is asked about this storey alone, and at once."""
        self._storey_to_match, self._matched_size = storey, MapSize()

    @property
    def confidence(self) -> float:
        """The least of the committed pairs."""
        given = self.committed.wall_surfaces if self.committed is not None else ()
        return min((c for _, _, c in given), default=self._confidence)

    def follow(
        self, storey: str, scene: Scene, walls: WallMap, T_map_local: Floats, confidence: float
    ) -> bool:  # fmt: skip
        """Takes over the place that other floors have, on a storey; whether the walls bear that out."""
        self.committed, self.follows = None, False
        place = self._place = self._known(walls, T_map_local)
        T_a_s = float(place[0]), float(place[1] + self.origin[0]), float(place[2] + self.origin[1])
        self.committed = MatchResult("unique", "its place is that of the floors above or below", T_a_s=T_a_s,
                                     floor=storey)  # fmt: skip
        if self.aligned_share(scene, walls, T_map_local) < self._config.anchors.least_share:
            self.committed = None
            return False
        self.match, self._matched_scene, self.follows, self._pairs = self.committed, scene, True, set()
        self._storey_to_match, self._confidence = storey, confidence
        return True

    def aligned_share(self, scene: Scene, walls: WallMap, T_map_local: Floats | None) -> float:
        """The share of the walls that stand as planned; 0 where they agree on no place, or are too few to tell."""
        alignment = self.alignment(scene, walls, T_map_local)
        return 0.0 if alignment is None or sum(h.agrees for h in alignment.walls) < _LEAST_HELD else alignment.share

    def withdraw(self, scene: Scene, why: str) -> None:
        """Gives up what was committed to."""
        if self.committed is not None:
            self._withdraw(scene, why)

    def alignment(self, scene: Scene, walls: WallMap, T_map_local: Floats | None) -> WallAlignment | None:
        """The walls of `scene` that stand at planned ones; None where nothing is committed to, or where they do not
        agree on a place. `T_map_local` as in `update`."""
        if self.committed is None:
            return None
        return align_walls(
            scene, walls, self.storey, self.origin[:2], self._known(walls, T_map_local),
            self._config.anchors, self._confirmed_deviations,
        )  # fmt: skip

    def _alignment_after_pull(self, scene: Scene, walls: WallMap, T_map_local: Floats | None) -> WallAlignment | None:
        """As `alignment`; a map that has drifted gives way when it is pulled straight, walls that were built elsewhere do
        not: those are taken for such from now on."""
        alignment = self.alignment(scene, walls, T_map_local)
        if alignment is None or not self._drift_candidates:
            return alignment
        stay = {
            (scene.wall_of_surface[h.surface.id], h.planned.id)
            for h in alignment.walls
            if abs(h.offset) > _STAYS * alignment.gate
        }
        stay &= self._drift_candidates
        if not stay - self._confirmed_deviations:
            return alignment
        self._confirmed_deviations |= stay
        return self.alignment(scene, walls, T_map_local)

    def _match(self, scene: Scene, walls: WallMap, T_map_local: Floats | None, last: bool) -> None:
        """Asks the matcher, with the whole building open to it; commits to a unique answer that the walls bear out
        when it is clear, when the unique one before it, on a smaller map, earlier the same, or when it is the `last` time.

        An answer that says otherwise than the one committed to replaces it, and all that hung on that is withdrawn.
        """
        self.rejection = ""
        s, plan, settings, by_room = scene.graph, self._plan(self._storey_to_match), self._config.anchors, None
        match = self._matcher.match(s, plan)
        if self._partial:
            match = verified_match(match, s, self._plan, settings)
            if match.status != "unique" and self.committed is None:
                by_room = relocalise_by_rooms(s, lambda part: self._matcher.match(part, plan), self._plan, settings)
        self.match = match = by_room or match
        self._matched_scene = scene
        self._match_count += 1
        rooms = len(scene.graph.rooms)
        _log.info("match %d, of %d rooms: %s, %s", self._match_count, rooms, match.status, match.reason)
        place = self._verified_place(match, scene, walls) if match.status == "unique" else None
        if place is None:
            self._last_unique = None if self._partial else self._last_unique
            return
        replaced = self.committed is not None and (
            match.floor != self.committed.floor or _differ(place, self._known(walls, T_map_local), scene)
        )
        if replaced and self.follows:
            return
        again = self._is_confirmed(match, place, scene, by_room is not None)
        told = is_strong if by_room is not None else is_overwhelming
        sure = told(match) and last if self._partial else is_clear(match) or last
        if self.committed is None and not (again or sure):
            return
        if replaced:
            self._withdraw(scene, f"match {self._match_count} places the map elsewhere")
            self._replaced = True
        self.committed, self._place, self.follows = match, place, False
        self._pairs = {(scene.wall_of_surface[s], a) for s, a, _ in match.wall_surfaces}

    def _is_confirmed(self, match: Match, place: Floats, scene: Scene, by_room: bool) -> bool:
        """Whether a smaller map earlier the same; takes note of it for the next time."""
        now = UniqueMatch(match.floor, place, evidence(match), MapSize.of(scene.graph), len(scene.graph.keyframes))
        earlier = self._last_unique
        same = earlier is not None and earlier.floor == match.floor and not _differ(place, earlier.place, scene)
        several = len(match.wall_surfaces) >= min(_SEVERAL, len(self._plan(match.floor).wall_surfaces))
        first = replace(earlier, place=place) if earlier is not None and same else now
        self._last_unique = first if several else None
        if by_room:  # which has no more evidence for it when others are added
            return same and now.map_size.has_grown_since(first.map_size)
        confirmed_by_growth = (
            is_strong(match) and now.has_more_evidence_than(first)
            if self._partial
            else first.is_confirmable(now.keyframes)
        )
        return same and confirmed_by_growth

    def _verified_place(self, match: Match, scene: Scene, walls: WallMap) -> Floats | None:
        """The place (3,) T_local_level that most matched walls agree on, near the one that the match tells; None where
        there is none, or where something speaks against it."""
        assert match.T_a_s is not None  # a unique answer has a motion
        place = None
        if self._possible_storeys and match.floor not in self._possible_storeys:
            self.rejection = "the way from floor to floor speaks against it"
        else:
            pairs = [(scene.graph.surface_by_id[s], self._a.surface_by_id[a]) for s, a, _ in match.wall_surfaces]
            told = np.array(match.T_a_s) - np.array([0.0, *self.origin[:2]])
            place = place_from_match(pairs, scene, walls, self.origin[:2], told, self._config.anchors)
            if place is None:
                self.rejection = "its walls do not agree on a place"
            elif self._conflicts(scene, place, match.floor):
                self.rejection, place = CONFLICT_REASON, None
        if place is None:
            _log.info("match %d is not committed to: %s", self._match_count, self.rejection)
        return place

    def _conflicts(self, scene: Scene, place: Floats, storey: str | None) -> bool:
        """Whether the map, at a place (3,) T_local_level, and a partial plan have walls elsewhere."""
        T_a_s = place + np.array([0.0, *self.origin[:2]])
        return self._partial and conflict_share(scene.graph, self._plan(storey), T_a_s) > WITHDRAWAL_CONFLICT

    def _withdraw(self, scene: Scene, why: str) -> None:
        self.committed, self._pairs, self.follows = None, set(), False
        self._drift_candidates, self._confirmed_deviations = set(), set()
        self.log.withdraw_all(scene.graph.keyframes[-1].stamp_ns, why)
        _log.warning("the match that the anchors stood on is withdrawn: %s", why)

    def _known(self, walls: WallMap, T_map_local: Floats | None) -> Floats:
        """(3,) T_local_level as far as it is known."""
        if T_map_local is None or self._replaced:
            return self._place
        return planar_pose(inverse(walls.T_level_map @ T_map_local))

    @property
    def storey(self) -> SceneGraph:
        """The storey of the plan that was committed to; the whole plan where there is none, or no storey is named."""
        floor = self.committed.floor if self.committed is not None else None
        return self._plan(floor)

    @property
    def elevation(self) -> float | None:
        """Of the committed storey's floor, BIM frame."""
        floor = self.committed.floor if self.committed is not None else None
        return next((f.elevation for f in self._a.floors if f.id == floor), None)

    @property
    def height(self) -> float:
        """Of the committed storey's floor, local frame; 0 where it is not known."""
        return 0.0 if self.elevation is None else self.elevation - float(self.origin[2])

    def _log_anchors(self, scene: Scene, alignment: WallAlignment) -> dict[Key, AnchorStatus]:
        holds: dict[Key, AnchorStatus] = {}
        for aligned in alignment.walls:
            key = (scene.wall_of_surface[aligned.surface.id], aligned.planned.id)
            by = f"match {self._match_count}" if key in self._pairs else "position"
            if aligned.agrees:
                holds[key] = AnchorStatus("tight", by, f"as planned within {1000 * alignment.gate:.0f} mm")
            elif aligned.drifted:
                holds[key] = AnchorStatus(
                    "tight", by, f"{1000 * aligned.offset:+.0f} mm off, as all around: the map has drifted"
                )
            elif key not in holds:
                holds[key] = AnchorStatus("loose", by, f"{1000 * aligned.offset:+.0f} mm off the plan")
        self.log.update(scene.graph.keyframes[-1].stamp_ns, holds)
        return holds

    def _anchors(
        self,
        scene: Scene,
        walls: WallMap,
        alignment: WallAlignment,
        T_map_local: Floats | None,
        holds: dict[Key, AnchorStatus],
    ) -> Anchors:
        assert self.committed is not None
        T_local_level = se2_to_se3(alignment.place[0], alignment.place[1], alignment.place[2], self.height)
        tight: dict[int, dict[str, PlannedWall]] = {}
        settings = self._config.anchors
        drifted: dict[int, dict[str, PlannedWall]] = {}
        loose: dict[int, dict[str, PlannedWall]] = {}
        by_rooms: dict[tuple[str, str], dict[int, Floats]] = {}
        for aligned in alignment.walls:
            wall, plane = scene.wall_of_surface[aligned.surface.id], self._local_plane(aligned.planned)
            middle = np.array([*aligned.surface.centroid, np.mean(aligned.surface.height or 0.0)])
            told = holds[wall, aligned.planned.id]
            place = transform_points(T_local_level, middle)
            planned = PlannedWall(plane, place, aligned.planned.id, told.by, told.why)
            pulls = aligned.drifted or abs(aligned.offset) < settings.doubtful
            (tight if aligned.agrees else drifted if pulls else loose).setdefault(wall, {})[aligned.planned.id] = (
                planned
            )
            if (aligned.agrees or pulls) and aligned.surface.room is not None and aligned.planned.room is not None:
                by_rooms.setdefault((aligned.surface.room, aligned.planned.room), {})[wall] = plane
        known = self._known(walls, T_map_local)
        if T_map_local is None or self._replaced or _differ(alignment.place, known, scene, settings.gate_offset):
            T_map_local = inverse(T_local_level @ walls.T_level_map)
        rooms = room_anchors(scene, by_rooms, self.height) if settings.rooms else {}
        if not settings.planes:
            tight = drifted = loose = {}
        return Anchors(
            T_map_local, {wall: list(p.values()) for wall, p in tight.items()}, rooms,
            {} if self.elevation is None else {self.number: self.height},
            {wall: list(p.values()) for wall, p in loose.items() if wall not in tight and wall not in drifted},
            {wall: list(p.values()) for wall, p in drifted.items() if wall not in tight}, f"match {self._match_count}",
        )  # fmt: skip

    def _local_plane(self, surface: WallSurface) -> Floats:
        plane = np.array(surface.plane or factors.plane_from_wall(surface.normal, surface.centroid), dtype=float)
        plane[:3] /= np.linalg.norm(plane[:3])
        plane[3] += plane[:3] @ self.origin
        return plane

    def answer(self, scene: Scene, alignment: WallAlignment | None) -> Mapping[str, Any] | None:
        """The answer in the form of matches.json, by the ids of `scene`: the committed one where there is one, less
        what the walls' positions contradict, and with what they add."""
        if self.committed is None or alignment is None:
            return None if self.match is None else self.match.to_dict()
        about_scene = self.committed is self.match and self._matched_scene is scene
        given = {s: (a, c) for s, a, c in self.committed.wall_surfaces} if about_scene else {}
        least = self.confidence
        surfaces = []
        for aligned in alignment.walls:
            a_id, confidence = given.get(aligned.surface.id, (aligned.planned.id, least))
            if aligned.agrees or aligned.surface.id in given or not about_scene:
                surfaces.append(
                    [aligned.surface.id, aligned.planned.id, confidence if a_id == aligned.planned.id else least]
                )
        rooms = matched_rooms(alignment.walls, self.committed.rooms if about_scene else (), least)
        return {**self.committed.to_dict(), "rooms": rooms, "wall_surfaces": surfaces}


def _differ(place: Floats, other: Floats, scene: Scene, metres: float = _APART[0]) -> bool:
    """Whether two places (3,) in the plan differ at the map's middle by so many metres, or by five degrees."""
    c, s = np.cos([place[0], other[0]]), np.sin([place[0], other[0]])
    x, y = scene.graph.centroid()
    put = np.column_stack([c * x - s * y, s * x + c * y]) + np.stack([place[1:], other[1:]])
    turn = (place[0] - other[0] + np.pi) % (2 * np.pi) - np.pi
    return bool(np.hypot(*(put[0] - put[1])) > metres or abs(turn) > _APART[1])
