"""Anchors one floor of the S-graph: matches it with the plan, aligns its walls, and withdraws what proves wrong."""

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from data.geometry import se2
from matching.result import AnyMatcher, MatchResult
from sgslam.anchoring.anchor_log import AnchorLog
from sgslam.anchoring.anchored_rooms import anchor_statuses, matched_rooms, planned_walls, room_anchors
from sgslam.anchoring.floor_matching import FloorMatching
from sgslam.anchoring.level_alignment import ALIKE, align_levels
from sgslam.anchoring.place_posterior import Place, differ
from sgslam.anchoring.plan import Plan
from sgslam.anchoring.wall_alignment import WallAlignment, align_walls, planar_pose
from sgslam.config import Config
from sgslam.config.sensor import SENSOR
from sgslam.geometry.frames import inverse
from sgslam.mapping import Anchors, FloorMap, Scene, WallMap

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
_LEAST_SHARE = 0.5  # of the walls, that stand as planned; below, the map is matched again
_LEAST_AGREEING = 0.3  # of the walls, for the map to be anchored at a place


class Cut(NamedTuple):
    """A floor of the map with its rooms, and the back end's estimate T_map_local (4, 4), None where it has none."""

    floor: FloorMap
    scene: Scene
    T_map_local: Floats | None

    @property
    def walls(self) -> WallMap:
        """The walls of the floor."""
        return self.floor.walls

    @property
    def T_local_level(self) -> Floats | None:  # noqa: N802
        """(4, 4) the place of the levelled map in the local frame by the back end, None where it has none."""
        return None if self.T_map_local is None else inverse(self.walls.T_level_map @ self.T_map_local)


@dataclass(frozen=True, eq=False)
class Commitment:
    """The match that the anchors stand on, its place (3,), T_local_level, yaw x y, the least confidence of its pairs of
    walls, and its name in the log. `follows`: the place, the confidence and the name are those of another floor."""

    match: MatchResult
    place: Floats
    confidence: float
    name: str
    follows: bool = False


class FloorAnchoring:
    """Keeps the matcher's answers for floor `number` of the S-graph, and turns a sure one into anchors.

    `matching` holds the answers, `commitment` the one that the anchors stand on, `log` the anchors' history.
    """

    def __init__(self, plan: Plan, matcher: AnyMatcher, config: Config, number: int = 0) -> None:
        self._plan, self._config, self.number = plan, config, number
        self.matching = FloorMatching(plan, matcher, config.anchors)
        self.commitment: Commitment | None = None
        self.log = AnchorLog()
        self._replaced = False  # the back end's estimate is still that of a match that was withdrawn

    @property
    def committed(self) -> MatchResult | None:
        """The answer that the anchors stand on; None where there is none."""
        return None if self.commitment is None else self.commitment.match

    @property
    def storey(self) -> str | None:
        """The id of the committed storey; None where there is none, or no storey is named."""
        return None if self.committed is None else self.committed.floor

    @property
    def follows(self) -> bool:
        """Whether the committed place is that of another floor."""
        return self.commitment is not None and self.commitment.follows

    @property
    def height(self) -> float:
        """Height (m) of the committed storey's floor in the local frame; 0 where it is not known."""
        return self._plan.height(self.storey)

    def update(self, cut: Cut, last: bool) -> Anchors | None:
        """Returns the anchors that hold now; None where there are none.

        Without anchors, the matcher is asked about each new map, and the `last` time in any case. With
        anchors, walls are aligned by position, and the matcher is asked again only where too few stand as planned.
        """
        scene = cut.scene
        self.log.rename(cut.walls.current)
        alignment = self.alignment(cut)
        due = last or self.matching.is_due(scene.graph)
        if due and (alignment is None or alignment.share < _LEAST_SHARE):
            before = self.commitment
            self._ask(cut, last)
            if before is not None and self.commitment is before and alignment is None:
                self.withdraw(scene, "the walls no longer agree on a place in the plan")
            alignment = self.alignment(cut)
        if alignment is None or self.commitment is None:
            return None
        statuses = anchor_statuses(alignment, scene, self.commitment.name)
        self.log.update(scene.graph.keyframes[-1].stamp_ns, statuses)
        anchors = self._anchors(cut, alignment)
        self._replaced = False
        return anchors

    def confirm(self, cut: Cut) -> bool:
        """Matches the final map once more; returns whether the committed place is still probable, or there was none
        before or after. If it is not, the commitment is withdrawn."""
        was_committed = self.commitment is not None
        self._ask(cut, last=True)
        return (self.commitment is not None) == was_committed and not self._replaced

    def follow(self, storey: str, cut: Cut, leading: "FloorAnchoring") -> None:
        """Takes over the place of the `leading` floor on a storey, if the walls agree with it."""
        base = leading.commitment
        if base is None or cut.T_local_level is None:
            return
        place = planar_pose(cut.T_local_level)
        yaw, x, y = self._plan.T_a_s(place).tolist()
        reason = "its place follows from the floors above or below"
        match = MatchResult("unique", reason, T_a_s=(yaw, x, y), floor=storey)
        self.commitment = Commitment(match, place, base.confidence, base.name, follows=True)
        alignment = self.alignment(cut)
        if alignment is None or alignment.share < _LEAST_SHARE:
            self.commitment = None
        else:
            self.matching.take_over(match, cut.scene, leading.matching.posterior.two_best[0][0])

    def withdraw(self, scene: Scene, why: str) -> None:
        """Withdraws the commitment and its anchors, if there are any."""
        if self.commitment is not None:
            self.commitment = None
            self.log.update(scene.graph.keyframes[-1].stamp_ns, {}, why)
            _log.warning("the match behind the anchors is withdrawn: %s", why)

    def alignment(self, cut: Cut) -> WallAlignment | None:
        """The walls of a floor at planned ones; None where nothing is committed, or they agree on no place."""
        if self.commitment is None:
            return None
        return self._aligned(cut, self.storey, self._place(cut))

    def answer(self, scene: Scene, alignment: WallAlignment | None) -> Mapping[str, Any] | None:
        """The answer in the form of matches.json, by the ids of `scene`.

        It is the committed one where there is one, without the pairs that the walls' positions contradict and with
        those that they add.
        """
        if self.commitment is None or alignment is None:
            return None if self.matching.match is None else self.matching.match.to_dict()
        match, least = self.commitment.match, self.commitment.confidence
        about_scene = match is self.matching.match and self.matching.scene is scene
        given = {s: (a, c) for s, a, c in match.wall_surfaces} if about_scene else {}
        surfaces = []
        for aligned in alignment.walls:
            a_id, confidence = given.get(aligned.surface.id, (aligned.planned.id, least))
            if aligned.agrees or aligned.surface.id in given or not about_scene:
                confidence = confidence if a_id == aligned.planned.id else least
                surfaces.append([aligned.surface.id, aligned.planned.id, confidence])
        rooms = matched_rooms(alignment.walls, match.rooms if about_scene else (), least)
        return {**match.to_dict(), "rooms": rooms, "wall_surfaces": surfaces}

    def _place(self, cut: Cut) -> Floats:
        """(3,) T_local_level by the back end's estimate where it is valid, else that of the match."""
        T = None if self._replaced else cut.T_local_level
        if T is not None:
            return planar_pose(T)
        assert self.commitment is not None
        return self.commitment.place

    def _aligned(self, cut: Cut, storey: str | None, place: Floats) -> WallAlignment | None:
        floor, origin = self._plan.storey(storey), self._plan.origin[:2]
        return align_walls(cut.scene, cut.walls, floor, origin, place, self._config.anchors)

    def commitment_at(self, chosen: Place, cut: Cut) -> Commitment | None:
        """What is committed to at one of the places of the newest answer; None where the walls do not agree there."""
        alignment = self._aligned(cut, chosen.floor, self._plan.in_local(chosen.T_a_s))
        if alignment is None or alignment.share < _LEAST_AGREEING:
            self.matching.reject("its walls do not agree on a place")
            return None
        match = self.matching.settle(chosen)
        confidence = min((c for _, _, c in match.wall_surfaces), default=chosen.probability)
        return Commitment(match, alignment.place, confidence, f"match {self.matching.count}")

    def _ask(self, cut: Cut, last: bool) -> None:
        """Asks the matcher and commits to a sure answer.

        An answer that places the map elsewhere replaces the committed one; a committed place that is no longer
        probable is withdrawn. A place that follows from another floor is that floor's to change.
        """
        matching, graph, before = self.matching, cut.scene.graph, self.commitment
        matching.ask(cut.scene, last)
        found = self.commitment_at(matching.posterior.places[0], cut) if matching.is_sure else None
        if before is not None:
            here, storey = self._place(cut), before.match.floor
            probability = matching.posterior.at(self._plan.T_a_s(here), storey, graph)
            elsewhere = found is not None and (found.match.floor != storey or differ(found.place, here, graph))
            if before.follows and (elsewhere or found is None):
                return
            if elsewhere:
                self.withdraw(cut.scene, f"match {matching.count} places the map elsewhere")
                self._replaced = True
            elif found is None and probability < self._config.anchors.withdraw:
                self.withdraw(cut.scene, matching.reason)
        self.commitment = found or self.commitment

    def _anchors(self, cut: Cut, alignment: WallAlignment) -> Anchors:
        """The anchors, at the back end's place unless that has moved off the one of walls and levels."""
        settings, origin, T_level_map = self._config.anchors, self._plan.origin, cut.walls.T_level_map
        T_bim_level = se2.to_se3(self._plan.T_a_s(alignment.place))
        levels, planned_levels = cut.floor.levels.levels(T_level_map), self._plan.levels(self.storey)
        heights = align_levels(levels, planned_levels, T_bim_level, float(origin[2]), settings)
        T_local_level = se2.to_se3(alignment.place, self.height if heights is None else heights.raised)
        T_map_local, T = cut.T_map_local, cut.T_local_level
        if (
            T is None
            or self._replaced
            or differ(alignment.place, planar_pose(T), cut.scene.graph, SENSOR.apart)
            or (heights is not None and abs(float(T[2, 3]) - heights.raised) > ALIKE)
        ):
            T_map_local = inverse(T_local_level @ T_level_map)
        assert T_map_local is not None
        planes = planned_walls(alignment, cut.scene, T_local_level, origin) if settings.planes else {}
        rooms = room_anchors(alignment, cut.scene, origin, self.height) if settings.rooms else {}
        return Anchors(T_map_local, planes, rooms, {} if heights is None else heights.planned)
