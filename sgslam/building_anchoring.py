"""All floors of the S-graph in one building: each is matched, and all hang on one BIM frame."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from sgslam.anchor_log import AnchorRecord
from sgslam.anchoring import Anchoring
from sgslam.backend import Anchors
from sgslam.config import Config
from sgslam.floors import FloorMap, Floors
from sgslam.frames import inverse
from sgslam.holding import Holding
from sgslam.matcher_protocol import AnyMatcher
from sgslam.scene import Scene

Floats = NDArray[np.float64]
Scened = list[tuple[FloorMap, Scene]]


class BuildingAnchoring:
    """Anchors the floors of the S-graph, each by an `Anchoring` of its own; `a_graph` in the BIM frame.

    `origin` (3,) is where the local frame of the factor graph lies in the BIM's.
    """

    def __init__(self, a_graph: SceneGraph, matcher: AnyMatcher, config: Config) -> None:
        self._a, self._matcher, self._config = a_graph, matcher, config
        elevations = [floor.elevation for floor in a_graph.floors if floor.elevation is not None]
        self.origin = np.array([*a_graph.centroid(), min(elevations, default=0.0)])
        self._of: dict[int, Anchoring] = {}

    def of(self, number: int) -> Anchoring:
        """The anchoring of one floor of the S-graph."""
        if number not in self._of:
            self._of[number] = Anchoring(self._a, self._matcher, self._config, self.origin, number)
        return self._of[number]

    def state(self) -> dict[str, Any]:
        """What it knows, as a tree (see `state_tree`)."""
        return {"of": {number: own.state() for number, own in self._of.items()}}

    def restore(self, state: dict[str, Any]) -> None:
        """Goes on from what `state` told."""
        self._of.clear()
        for number, told in state["of"].items():
            self.of(number).restore(told)

    @property
    def committed(self) -> Anchoring | None:
        """The first floor's anchoring that a match was committed to."""
        return next((own for own in self._of.values() if own.committed is not None), None)

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
        return own.match.reason if own.committed is None else own.committed.reason

    def update(self, floors: Floors, T_map_local: Floats | None, last: bool) -> Anchors | None:
        """The anchors of all floors that hold now; see `Anchoring.update`."""
        found = []
        for floor, scene in _cut(floors):
            anchors = self.of(floor.number).update(scene, floor.walls, T_map_local, last)
            if anchors is not None:
                found.append(anchors)
        return merged(found) if found else None

    def confirm(self, floors: Floors, T_map_local: Floats | None) -> bool:
        """Whether the matcher says of every floor, on the final map, what was committed to; see `Anchoring.confirm`."""
        answers = [self.of(floor.number).confirm(scene, floor.walls, T_map_local) for floor, scene in _cut(floors)]
        return all(answers)

    def bim_from_map(self, T_map_local: Floats) -> Floats:
        """(4, 4) the map in the BIM frame, from the back end's estimate."""
        T = inverse(T_map_local)
        T[:3, 3] += self.origin
        return T

    def holdings(self, floors: Floors, T_map_local: Floats | None) -> dict[int, Holding]:
        """The walls that stand at planned ones, floor by floor; see `Anchoring.holding`."""
        found = {f.number: self.of(f.number).holding(scene, f.walls, T_map_local) for f, scene in _cut(floors)}
        return {number: holding for number, holding in found.items() if holding is not None}

    def answer(self, floors: Floors, holdings: dict[int, Holding]) -> dict[str, Any] | None:
        """The answer in the form of matches.json, over all floors; `floors` in it tells each one's storey."""
        answers = {}
        for floor, scene in _cut(floors):
            answers[floor.number] = self.of(floor.number).answer(scene, holdings.get(floor.number))
        first = self.committed.number if self.committed is not None else min(answers, default=0)
        told = answers.get(first)
        if told is None:
            return None
        placed = {n: a for n, a in answers.items() if a is not None and (n in holdings or n == first)}
        return {
            **told,
            "rooms": [pair for a in placed.values() for pair in a["rooms"]],
            "wall_surfaces": [pair for a in placed.values() for pair in a["wall_surfaces"]],
            "floors": {f"floor-{n}": placed[n].get("floor") for n in sorted(placed)},
        }


def _cut(floors: Floors) -> Scened:
    return [(floor, floor.scene) for floor in floors.maps if floor.scene is not None]


def merged(anchors: list[Anchors]) -> Anchors:
    """The anchors of several floors, at least one, as one building's."""
    first = anchors[0]
    for more in anchors[1:]:
        first = replace(
            first, planes=first.planes | more.planes, rooms=first.rooms | more.rooms,
            elevations=first.elevations | more.elevations, loose=first.loose | more.loose, bent=first.bent | more.bent,
        )  # fmt: skip
    return first
