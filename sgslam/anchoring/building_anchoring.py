"""Anchors all floors of the S-graph in one building: each floor is matched, and all share one BIM frame."""

import logging
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from matching.result import AnyMatcher, MatchResult
from sgslam.anchoring.anchor_log import AnchorRecord
from sgslam.anchoring.floor_anchoring import FloorAnchoring
from sgslam.anchoring.place_posterior import PlacePosterior, differ, joint_posterior
from sgslam.anchoring.plan import Plan
from sgslam.anchoring.storey_hypotheses import Assignment, assignments
from sgslam.anchoring.wall_alignment import WallAlignment
from sgslam.config import Config
from sgslam.geometry.frames import inverse
from sgslam.mapping import Anchors, FloorMap, Floors, Scene

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
FloorScenes = list[tuple[FloorMap, Scene]]


class BuildingAnchoring:
    """Anchors each floor of the S-graph with a `FloorAnchoring` of its own; `a_graph` in the BIM frame.

    `start` is the id of the storey on which the run begins, None where it is not known. A `partial` plan is the map of
    an earlier run, which lacks rooms that were not visited.
    """

    def __init__(
        self,
        a_graph: SceneGraph,
        matcher: AnyMatcher,
        config: Config,
        start: str | None = None,
        partial: bool = False,
    ) -> None:
        self._plan, self._matcher, self._config = Plan(a_graph, partial), matcher, config
        self._start = start
        self._of: dict[int, FloorAnchoring] = {}
        self._possible: list[Assignment] | None = None
        self._joint: Assignment = {}  # the storeys that all floors together made sure; empty without a place by them

    def of(self, number: int) -> FloorAnchoring:
        """The anchoring of one floor of the S-graph."""
        if number not in self._of:
            self._of[number] = FloorAnchoring(self._plan, self._matcher, self._config, number)
        return self._of[number]

    @property
    def origin(self) -> Floats:
        """(3,) the origin of the factor graph's local frame in the BIM frame."""
        return self._plan.origin

    @property
    def partial(self) -> bool:
        """Whether the plan is the map of an earlier run."""
        return self._plan.partial

    @property
    def a_graph(self) -> SceneGraph:
        """The whole plan, BIM frame."""
        return self._plan.a_graph

    @property
    def committed(self) -> FloorAnchoring | None:
        """The anchoring of the floor that the others follow: one with a committed match; None before that."""
        return self._leading or next((own for own in self._of.values() if own.committed is not None), None)

    @property
    def posterior(self) -> PlacePosterior:
        """What is believed of the place of the floor that the others follow, or of the first one that was matched."""
        known = (own for own in self._of.values() if own.match is not None)
        own = self.committed or next(known, None)
        return PlacePosterior() if own is None else own.matching.posterior

    @property
    def newest_matches(self) -> dict[int, MatchResult]:
        """The newest answer of the matcher for each floor that was matched."""
        return {number: own.match for number, own in self._of.items() if own.match is not None}

    @property
    def records(self) -> tuple[AnchorRecord, ...]:
        """The records of all anchors so far, withdrawn ones included."""
        return tuple(record for own in self._of.values() for record in own.log.records)

    @property
    def reason(self) -> str:
        """One line: why the map is anchored, or why it is not."""
        own = self.committed or next((own for own in self._of.values() if own.match is not None), None)
        if own is None or own.match is None:
            return "too little was seen to try a match"
        return own.reason if own.committed is None else own.committed.reason

    def update(self, floors: Floors, T_map_local: Floats | None, last: bool) -> Anchors | None:
        """Returns the anchors of all floors that hold now; see `FloorAnchoring.update`.

        Where no floor has a unique answer of its own, all floors are matched jointly. Where one has, the others take
        their places from it and from their height above it. Where the heights fit no storeys, since the odometry
        slipped on the stairs, each needs an answer of its own, at the same place in plan view.
        """
        cut, found = _with_scenes(floors), []
        base = self.committed
        if base is None:
            self._joint = {}
        self._restrict_storeys(floors)
        for floor, scene in cut:
            own = self.of(floor.number)
            if base is None or own.committed is not None or self._heights_slipped:
                anchors = own.update(floor, scene, T_map_local, last)
                if base is not None and self._heights_slipped and self._is_displaced(own, base, scene):
                    own.withdraw(scene, "the floors above or below are elsewhere")
                    anchors = None
                found += [] if anchors is None else [anchors]
                base = self.committed
        if base is None and len(cut) > 1:
            self._match_jointly(cut)
            self._restrict_storeys(floors)
        elif base is not None and T_map_local is not None and not self._heights_slipped:
            self._propagate(base, cut, T_map_local)
        return merged(found) if found else None

    def _restrict_storeys(self, floors: Floors) -> None:
        """Restricts each floor to the storeys that the heights between the floors allow, and all floors together."""
        first = floors.maps[0].walls.T_level_map[2, 3]
        heights = {f.number: float(first - f.walls.T_level_map[2, 3]) for f in floors.maps}
        self._possible = assignments(heights, self._plan.a_graph.floors, self._start)
        joint = [a for a in self._possible or () if self._joint.items() <= a.items()]
        self._possible = joint or self._possible
        for floor in floors.maps:
            own = self.of(floor.number)
            storeys = [a[floor.number] for a in self._possible or () if floor.number in a]
            own.matching.restrict_storeys(storeys, storeys[0] if self._start is not None and storeys else None)

    def _match_jointly(self, cut: FloorScenes) -> None:
        """Commits to the place that all floors together make sure, on the floor with most evidence for it; the others
        follow it."""
        asked = {floor.number: (floor, scene) for floor, scene in cut if self.of(floor.number).match is not None}
        matches = {number: match for number, match in self.newest_matches.items() if number in asked}
        if not self._possible or len(matches) < 2:
            return
        graphs = {number: scene.graph for number, (_, scene) in asked.items()}
        assigned, posterior = joint_posterior(matches, graphs, self._possible)
        if not posterior.places or posterior.places[0].probability < self._config.anchors.commit:
            return
        best, self._joint = posterior.places[0], assigned
        _log.info("storeys by all floors together: %s", assigned)
        own = {k: self.of(k).matching.posterior.at(np.array(best.T_a_s), assigned[k], graphs[k]) for k in matches}
        number = max(own, key=lambda k: own[k])
        floor, scene = asked[number]
        self.of(number).commit_to(replace(best, floor=assigned[number]), scene, floor.walls)

    def _propagate(self, base: FloorAnchoring, cut: FloorScenes, T_map_local: Floats) -> None:
        """Gives the other floors the place of the floor `base`, which has an answer."""
        storey = base.committed.floor if base.committed is not None else None
        possible = [a for a in self._possible or () if a.get(base.number) == storey]
        for floor, scene in cut:
            own = self.of(floor.number)
            if own is base:
                continue
            expected = possible[0].get(floor.number) if len(possible) == 1 else None
            if own.committed is not None and own.committed.floor != expected:
                own.withdraw(scene, "the floors above or below are elsewhere")
            if own.committed is None and expected is not None:
                own.follow(expected, scene, floor.walls, T_map_local, base)

    @property
    def _heights_slipped(self) -> bool:
        """Whether the heights between the floors are known and fit no storeys of the plan."""
        return self._possible is not None and not self._possible

    @staticmethod
    def _is_displaced(own: FloorAnchoring, base: FloorAnchoring, scene: Scene) -> bool:
        """Whether a floor has an answer whose place in plan view is not that of the floor `base`."""
        return own.committed is not None and differ(own.commitment.place, base.commitment.place, scene.graph)

    def confirm(self, floors: Floors, T_map_local: Floats | None) -> bool:
        """Matches the final map; returns whether all floors keep their commitment. See `FloorAnchoring.confirm`.

        Floors that follow others are confirmed by their walls.
        """
        confirmed = True
        for floor, scene in _with_scenes(floors):
            own = self.of(floor.number)
            if not own.commitment.follows:
                confirmed &= own.confirm(scene, floor.walls, T_map_local)
        for floor, scene in _with_scenes(floors):
            own = self.of(floor.number)
            if own.commitment.follows and (
                self._leading is None or not own.aligned_share(scene, floor.walls, T_map_local)
            ):
                own.withdraw(scene, "its walls are not where the floors above or below place it")
                confirmed = False
        return confirmed

    @property
    def _leading(self) -> FloorAnchoring | None:
        followed = (own for own in self._of.values() if not own.commitment.follows)
        return next((own for own in followed if own.committed is not None), None)

    def bim_from_map(self, T_map_local: Floats) -> Floats:
        """(4, 4) T_bim_map from the back end's T_map_local (4, 4)."""
        T = inverse(T_map_local)
        T[:3, 3] += self.origin
        return T

    def alignments(self, floors: Floors, T_map_local: Floats | None) -> dict[int, WallAlignment]:
        """The aligned walls by floor number; see `FloorAnchoring.alignment`."""
        found = {
            f.number: self.of(f.number).alignment(scene, f.walls, T_map_local) for f, scene in _with_scenes(floors)
        }
        return {number: alignment for number, alignment in found.items() if alignment is not None}

    def answer(self, floors: Floors, alignments: dict[int, WallAlignment]) -> dict[str, Any] | None:
        """The answer over all floors in the form of matches.json; its `floors` gives the storey of each."""
        answers = {}
        for floor, scene in _with_scenes(floors):
            answers[floor.number] = self.of(floor.number).answer(scene, alignments.get(floor.number))
        first = self.committed.number if self.committed is not None else min(answers, default=0)
        answer = answers.get(first)
        if answer is None:
            return None
        placed = {n: a for n, a in answers.items() if a is not None and (n in alignments or n == first)}
        return {
            **answer,
            "rooms": [pair for a in placed.values() for pair in a["rooms"]],
            "wall_surfaces": [pair for a in placed.values() for pair in a["wall_surfaces"]],
            "floors": {f"floor-{n}": placed[n].get("floor") for n in sorted(placed)},
        }


def _with_scenes(floors: Floors) -> FloorScenes:
    return [(floor, floor.scene) for floor in floors.maps if floor.scene is not None]


def merged(anchors: list[Anchors]) -> Anchors:
    """Merges the anchors of one or more floors into those of the building."""
    first = anchors[0]
    for more in anchors[1:]:
        planes, rooms = first.planes | more.planes, first.rooms | more.rooms
        first = replace(first, planes=planes, rooms=rooms, elevations=first.elevations | more.elevations)
    return first
