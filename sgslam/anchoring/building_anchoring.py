"""All floors of the S-graph in one building: each is matched, and all hang on one BIM frame."""

import logging
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from sgslam.anchoring.anchor_log import AnchorRecord
from sgslam.anchoring.floor_anchoring import FloorAnchoring
from sgslam.anchoring.matcher_protocol import AnyMatcher, Match
from sgslam.anchoring.storey_hypotheses import Assignment, assignments, match_jointly
from sgslam.anchoring.wall_alignment import WallAlignment
from sgslam.backend.backend import Anchors
from sgslam.config import Config
from sgslam.geometry.frames import inverse
from sgslam.mapping.floors import FloorMap, Floors
from sgslam.mapping.scene import Scene

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
FloorScenes = list[tuple[FloorMap, Scene]]


class BuildingAnchoring:
    """Anchors the floors of the S-graph, each by an `FloorAnchoring` of its own; `a_graph` in the BIM frame.

    `origin` (3,) is where the local frame of the factor graph lies in the BIM's; `start` is the id of the storey on
    which the run begins, where it is told. A `partial` plan is a map that lacks what was not driven through.
    """

    def __init__(
        self,
        a_graph: SceneGraph,
        matcher: AnyMatcher,
        config: Config,
        start: str | None = None,
        partial: bool = False,
    ) -> None:
        self._a, self._matcher, self._config = a_graph, matcher, config
        elevations = [floor.elevation for floor in a_graph.floors if floor.elevation is not None]
        self.origin = np.array([*a_graph.centroid(), min(elevations, default=0.0)])
        self._start, self.partial = start, partial
        self._of: dict[int, FloorAnchoring] = {}
        self._storeys: dict[str, SceneGraph] = {}
        self._possible: list[Assignment] | None = None
        self._jointly_matched_size = 0  # wall surfaces that there were

    def of(self, number: int) -> FloorAnchoring:
        """The anchoring of one floor of the S-graph."""
        if number not in self._of:
            self._of[number] = FloorAnchoring(
                self._a, self._matcher, self._config, self.origin, self._plan, number, self.partial
            )
        return self._of[number]

    def state(self) -> dict[str, Any]:
        """What it knows, as a tree (see `state_tree`)."""
        return {
            "jointly_matched_size": self._jointly_matched_size,
            "of": {number: own.state() for number, own in self._of.items()},
        }

    def restore(self, state: dict[str, Any]) -> None:
        """Goes on from what `state` told."""
        self._jointly_matched_size = state["jointly_matched_size"]
        self._of.clear()
        for number, told in state["of"].items():
            self.of(number).restore(told)

    @property
    def a_graph(self) -> SceneGraph:
        """The whole plan, BIM frame."""
        return self._a

    @property
    def committed(self) -> FloorAnchoring | None:
        """The anchoring of the floor that the others hang on: one that a match was committed to; None before that."""
        return self._leading or next((own for own in self._of.values() if own.committed is not None), None)

    @property
    def awaits_confirmation(self) -> bool:
        """Whether some floor's answer waits only for a larger map to say the same; see `FloorAnchoring.awaits_confirmation`."""
        return self.committed is None and any(own.awaits_confirmation for own in self._of.values())

    @property
    def newest_matches(self) -> dict[int, Match]:
        """The matcher's newest_matches answer for each floor that it was asked about."""
        return {number: own.match for number, own in self._of.items() if own.match is not None}

    @property
    def records(self) -> tuple[AnchorRecord, ...]:
        """Of all anchors so far, those withdrawn too."""
        return tuple(record for own in self._of.values() for record in own.log.records)

    @property
    def reason(self) -> str:
        """One line: why the map is anchored, or why it is not."""
        own = self.committed or next((own for own in self._of.values() if own.match is not None), None)
        if own is None or own.match is None:
            return "too little was seen to try a match"
        return own.rejection or own.match.reason if own.committed is None else own.committed.reason

    def update(self, floors: Floors, T_map_local: Floats | None, last: bool) -> Anchors | None:
        """The anchors of all floors that hold now; see `FloorAnchoring.update`.

        Where no floor has an answer of its own that is unique, all are asked together; where one has, the others take
        their places from it and from how high they lie above it.
        """
        self._restrict_storeys(floors)
        cut, found = _with_scenes(floors), []
        base = self.committed
        for floor, scene in cut:
            own = self.of(floor.number)
            if base is None or own.committed is not None:
                anchors = own.update(scene, floor.walls, T_map_local, last)
                found += [] if anchors is None else [anchors]
                base = self.committed
        if base is None and len(cut) > 1:
            self._match_jointly(cut)
        elif base is not None and T_map_local is not None:
            self._propagate(base, cut, T_map_local)
        return merged(found) if found else None

    def _restrict_storeys(self, floors: Floors) -> None:
        """Tells each floor which storeys it can be, by how high the floors lie above one another."""
        first = floors.maps[0].walls.T_level_map[2, 3]
        heights = {f.number: float(first - f.walls.T_level_map[2, 3]) for f in floors.maps}
        self._possible = assignments(heights, self._a.floors, self._start)
        for floor in floors.maps:
            own = self.of(floor.number)
            storeys = [a[floor.number] for a in self._possible or () if floor.number in a]
            own.restrict_storeys(storeys, storeys[0] if self._start is not None and storeys else None)

    def _match_jointly(self, cut: FloorScenes) -> None:
        """Commits to the one assignment and place that explains several floors, where there is one."""
        size = sum(len(scene.graph.wall_surfaces) for _, scene in cut)
        if not self._possible or size < 1.1 * self._jointly_matched_size:
            return
        self._jointly_matched_size = size
        graphs = {floor.number: scene.graph for floor, scene in cut}
        found = match_jointly(
            graphs, self._possible, lambda k, storey: self._matcher.match(graphs[k], self._plan(storey))
        )
        if found is None:
            return
        _log.info("storeys by all floors together: %s", found.reason)
        for number, answer in found.answers.items():
            if answer.status == "unique":
                self.of(number).match_only(found.assigned[number])

    def _propagate(self, base: FloorAnchoring, cut: FloorScenes, T_map_local: Floats) -> None:
        """Lets the other floors take their places from the one that has an answer."""
        storey = base.committed.floor if base.committed is not None else None
        possible = [a for a in self._possible or () if a.get(base.number) == storey]
        for floor, scene in cut:
            own = self.of(floor.number)
            if own is base:
                continue
            expected = possible[0].get(floor.number) if len(possible) == 1 else None
            if own.committed is not None and own.committed.floor != expected:
                own.withdraw(scene, "the floors above or below lie elsewhere")
            if own.committed is None and expected is not None:
                own.follow(expected, scene, floor.walls, T_map_local, base.confidence)

    def confirm(self, floors: Floors, T_map_local: Floats | None) -> bool:
        """Whether the matcher says of the floors, on the final map, what was committed to; see `FloorAnchoring.confirm`.

        Floors that follow others are confirmed by their walls.
        """
        confirmed = True
        for floor, scene in _with_scenes(floors):
            own = self.of(floor.number)
            if not own.follows:
                confirmed &= own.confirm(scene, floor.walls, T_map_local)
        for floor, scene in _with_scenes(floors):
            own = self.of(floor.number)
            if own.follows and (self._leading is None or not own.aligned_share(scene, floor.walls, T_map_local)):
                own.withdraw(scene, "its walls do not stand where the floors above or below place it")
                confirmed = False
        return confirmed

    @property
    def _leading(self) -> FloorAnchoring | None:
        return next((own for own in self._of.values() if own.committed is not None and not own.follows), None)

    def _plan(self, storey: str | None) -> SceneGraph:
        """The A-graph of a storey, always the same object; the whole one for None."""
        if storey is None:
            return self._a
        if storey not in self._storeys:
            self._storeys[storey] = self._a.on_floor(storey)
        return self._storeys[storey]

    def bim_from_map(self, T_map_local: Floats) -> Floats:
        """(4, 4) the map in the BIM frame, from the back end's estimate."""
        T = inverse(T_map_local)
        T[:3, 3] += self.origin
        return T

    def alignments(self, floors: Floors, T_map_local: Floats | None) -> dict[int, WallAlignment]:
        """The walls that stand at planned ones, floor by floor; see `FloorAnchoring.alignment`."""
        found = {
            f.number: self.of(f.number).alignment(scene, f.walls, T_map_local) for f, scene in _with_scenes(floors)
        }
        return {number: alignment for number, alignment in found.items() if alignment is not None}

    def answer(self, floors: Floors, alignments: dict[int, WallAlignment]) -> dict[str, Any] | None:
        """The answer in the form of matches.json, over all floors; `floors` in it tells each one's storey."""
        answers = {}
        for floor, scene in _with_scenes(floors):
            answers[floor.number] = self.of(floor.number).answer(scene, alignments.get(floor.number))
        first = self.committed.number if self.committed is not None else min(answers, default=0)
        told = answers.get(first)
        if told is None:
            return None
        placed = {n: a for n, a in answers.items() if a is not None and (n in alignments or n == first)}
        return {
            **told,
            "rooms": [pair for a in placed.values() for pair in a["rooms"]],
            "wall_surfaces": [pair for a in placed.values() for pair in a["wall_surfaces"]],
            "floors": {f"floor-{n}": placed[n].get("floor") for n in sorted(placed)},
        }


def _with_scenes(floors: Floors) -> FloorScenes:
    return [(floor, floor.scene) for floor in floors.maps if floor.scene is not None]


def merged(anchors: list[Anchors]) -> Anchors:
    """The anchors of several floors, at least one, as one building's."""
    first = anchors[0]
    for more in anchors[1:]:
        first = replace(
            first, planes=first.planes | more.planes, rooms=first.rooms | more.rooms,
            elevations=first.elevations | more.elevations, loose=first.loose | more.loose, drifted=first.drifted | more.drifted,
        )  # fmt: skip
    return first
