"""Anchors all floors of the S-graph in one building: each floor is matched, and all share one BIM frame."""

import logging
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from matching.result import AnyMatcher, MatchResult
from sgslam.anchoring.anchor_log import AnchorRecord
from sgslam.anchoring.floor_anchoring import Cut, FloorAnchoring
from sgslam.anchoring.place_posterior import PlacePosterior, differ, joint_posterior
from sgslam.anchoring.plan import Plan
from sgslam.anchoring.storey_hypotheses import Assignment, assignments
from sgslam.anchoring.wall_alignment import WallAlignment
from sgslam.config import Config
from sgslam.geometry.frames import inverse
from sgslam.mapping import Anchors, Floors

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)


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
        committed = [own for own in self._of.values() if own.committed is not None]
        return min(committed, key=lambda own: own.follows, default=None)

    @property
    def _first(self) -> FloorAnchoring | None:
        """The floor that the others follow, or the first one that was matched."""
        return self.committed or next((self.of(number) for number in self.newest_matches), None)

    @property
    def posterior(self) -> PlacePosterior:
        """What is believed of the place of the floor that the others follow, or of the first one that was matched."""
        return PlacePosterior() if self._first is None else self._first.matching.posterior

    @property
    def newest_matches(self) -> dict[int, MatchResult]:
        """The newest answer of the matcher for each floor that was matched."""
        return {number: own.matching.match for number, own in self._of.items() if own.matching.match is not None}

    @property
    def records(self) -> tuple[AnchorRecord, ...]:
        """The records of all anchors so far, withdrawn ones included."""
        return tuple(record for own in self._of.values() for record in own.log.records)

    @property
    def reason(self) -> str:
        """One line: why the map is anchored, or why it is not."""
        if self._first is None:
            return "too little was seen to try a match"
        return self._first.matching.reason if self._first.committed is None else self._first.committed.reason

    def update(self, floors: Floors, T_map_local: Floats | None, last: bool) -> Anchors | None:
        """Returns the anchors of all floors that hold now; see `FloorAnchoring.update`.

        Where no floor has a unique answer of its own, all floors are matched jointly. Where one has, the others take
        their places from it and from their height above it. Where the heights fit no storeys, since the odometry
        slipped on the stairs, each needs an answer of its own, at the same place in plan view.
        `T_map_local` (4, 4) is the back end's estimate of the local frame, None where it has none.
        """
        cuts, found, base = _cuts(floors, T_map_local), list[Anchors](), self.committed
        if base is None:
            self._joint = {}
        self._restrict_storeys(floors)
        heights_slipped = self._possible == []
        for cut in cuts:
            own = self.of(cut.floor.number)
            if base is None or own.committed is not None or heights_slipped:
                anchors = own.update(cut, last)
                if heights_slipped and _are_apart(own, base, cut):
                    own.withdraw(cut.scene, "the floors above or below are elsewhere")
                elif anchors is not None:
                    found.append(anchors)
                base = self.committed
        if base is None and len(cuts) > 1:
            self._match_jointly(cuts)
            self._restrict_storeys(floors)
        elif base is not None and not heights_slipped:
            self._propagate(base, cuts)
        return _merged(found) if found else None

    def _restrict_storeys(self, floors: Floors) -> None:
        """Restricts each floor to the storeys that the heights between the floors allow, and all floors together."""
        first = floors.maps[0].walls.T_level_map[2, 3]
        heights = {f.number: float(first - f.walls.T_level_map[2, 3]) for f in floors.maps}
        self._possible = assignments(heights, self._plan.a_graph.floors, self._start)
        joint = [a for a in self._possible or () if self._joint.items() <= a.items()]
        self._possible = joint or self._possible
        for floor in floors.maps:
            storeys = [a[floor.number] for a in self._possible or () if floor.number in a]
            self.of(floor.number).matching.restrict_storeys(storeys, self._start is not None)

    def _match_jointly(self, cuts: list[Cut]) -> None:
        """Commits to the place that all floors together make sure, on the floor with most evidence for it; the others
        follow it."""
        matched = {cut.floor.number: cut for cut in cuts if cut.floor.number in self.newest_matches}
        if not self._possible or len(matched) < 2:
            return
        graphs = {number: cut.scene.graph for number, cut in matched.items()}
        known = {number: self.of(number).matching.posterior for number in matched}
        assigned, posterior = joint_posterior(known, graphs, self._possible)
        if not posterior.places or posterior.places[0].probability < self._config.anchors.commit:
            return
        best, self._joint = posterior.places[0], assigned
        _log.info("storeys by all floors together: %s", assigned)
        T_a_s = np.array(best.T_a_s)
        number = max(matched, key=lambda k: known[k].at(T_a_s, assigned[k], graphs[k]))
        own = self.of(number)
        own.commitment = own.commitment_at(replace(best, floor=assigned[number]), matched[number])

    def _propagate(self, base: FloorAnchoring, cuts: list[Cut]) -> None:
        """Gives the other floors the place of the floor `base`, which has an answer, where the back end has it too."""
        possible = [a for a in self._possible or () if a.get(base.number) == base.storey]
        for cut in cuts:
            own = self.of(cut.floor.number)
            if own is base or cut.T_map_local is None:
                continue
            expected = possible[0].get(cut.floor.number) if len(possible) == 1 else None
            if own.committed is not None and own.storey != expected:
                own.withdraw(cut.scene, "the floors above or below are elsewhere")
            if own.committed is None and expected is not None:
                own.follow(expected, cut, base)

    def confirm(self, floors: Floors, T_map_local: Floats | None) -> bool:
        """Matches the final map; returns whether all floors keep their commitment. See `FloorAnchoring.confirm`.

        Floors that follow others are confirmed by their walls.
        """
        cuts = [(self.of(cut.floor.number), cut) for cut in _cuts(floors, T_map_local)]
        confirmed = True
        for own, cut in cuts:
            confirmed &= own.follows or own.confirm(cut)
        leads = any(own.committed is not None and not own.follows for own in self._of.values())
        for own, cut in cuts:
            if own.follows and (not leads or own.alignment(cut) is None):
                own.withdraw(cut.scene, "its walls are not where the floors above or below place it")
                confirmed = False
        return confirmed

    def bim_from_map(self, T_map_local: Floats) -> Floats:
        """(4, 4) T_bim_map from the back end's T_map_local (4, 4)."""
        T = inverse(T_map_local)
        T[:3, 3] += self.origin
        return T

    def alignments(self, floors: Floors, T_map_local: Floats | None) -> dict[int, WallAlignment]:
        """The aligned walls by floor number; see `FloorAnchoring.alignment`."""
        found = {cut.floor.number: self.of(cut.floor.number).alignment(cut) for cut in _cuts(floors, T_map_local)}
        return {number: alignment for number, alignment in found.items() if alignment is not None}

    def answer(self, floors: Floors, alignments: dict[int, WallAlignment]) -> dict[str, Any] | None:
        """The answer over all floors in the form of matches.json; its `floors` gives the storey of each."""
        answers = {
            cut.floor.number: self.of(cut.floor.number).answer(cut.scene, alignments.get(cut.floor.number))
            for cut in _cuts(floors, None)
        }
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


def _are_apart(own: FloorAnchoring, base: FloorAnchoring | None, cut: Cut) -> bool:
    """Whether a floor has another place in plan view than the floor `base`."""
    one, other = own.commitment, None if base is None else base.commitment
    return one is not None and other is not None and differ(one.place, other.place, cut.scene.graph)


def _cuts(floors: Floors, T_map_local: Floats | None) -> list[Cut]:
    return [Cut(floor, floor.scene, T_map_local) for floor in floors.maps if floor.scene is not None]


def _merged(anchors: list[Anchors]) -> Anchors:
    """Merges the anchors of one or more floors into those of the building."""
    first = anchors[0]
    for more in anchors[1:]:
        planes, rooms = first.planes | more.planes, first.rooms | more.rooms
        first = replace(first, planes=planes, rooms=rooms, elevations=first.elevations | more.elevations)
    return first
