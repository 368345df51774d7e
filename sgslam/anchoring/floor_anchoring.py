"""Anchors one floor of the S-graph: matches it with the plan, aligns its walls, and withdraws what proves wrong."""

import logging
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from matching.result import AnyMatcher, MatchResult
from sgslam.anchoring.anchor_log import AnchorLog, AnchorStatus, Key
from sgslam.anchoring.anchored_rooms import anchor_statuses, matched_rooms, planned_walls, room_anchors
from sgslam.anchoring.commitment import Commitment
from sgslam.anchoring.floor_matching import FloorMatching
from sgslam.anchoring.level_alignment import ALIKE, LevelAlignment, align_levels
from sgslam.anchoring.place_posterior import Place, differ
from sgslam.anchoring.plan import Plan
from sgslam.anchoring.wall_alignment import WallAlignment, align_walls
from sgslam.config import Config
from sgslam.geometry.frames import inverse, se2_to_se3
from sgslam.mapping import Anchors, FloorMap, Scene, WallMap

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
_LEAST_SHARE = 0.5  # of the walls, that stand as planned; below, the map is matched again
_MOVED = 0.15  # m between the back end's place and the one on which most walls agree, which is taken then
_MIN_WALLS = 4  # walls as planned, for a floor to take over the place of another one


class FloorAnchoring:
    """Keeps the matcher's answers for floor `number` of the S-graph, and turns a unique one into anchors.

    `matching` holds the answers, `commitment` the one that the anchors stand on, `log` the anchors' history.
    """

    def __init__(self, plan: Plan, matcher: AnyMatcher, config: Config, number: int = 0) -> None:
        self._plan, self._config, self.number = plan, config, number
        self.matching = FloorMatching(plan, matcher, config.anchors)
        self.commitment = Commitment()
        self.log = AnchorLog()

    @property
    def match(self) -> MatchResult | None:
        """The newest answer of the matcher; None before the first."""
        return self.matching.match

    @property
    def committed(self) -> MatchResult | None:
        """The answer that the anchors stand on; None where there is none."""
        return self.commitment.match

    @property
    def reason(self) -> str:
        """Why the newest answer is accepted, or why it is not; empty before the first."""
        return self.matching.rejection or ("" if self.match is None else self.match.reason)

    @property
    def storey(self) -> SceneGraph:
        """The A-graph of the committed storey; the whole A-graph where there is none, or no storey is named."""
        return self._plan.storey(self.commitment.floor)

    @property
    def height(self) -> float:
        """Height (m) of the committed storey's floor in the local frame; 0 where it is not known."""
        return self._plan.height(self.commitment.floor) or 0.0

    def update(self, floor: FloorMap, scene: Scene, T_map_local: Floats | None, last: bool) -> Anchors | None:
        """Returns the anchors that hold now; None where there are none.

        Without anchors, the matcher is asked about each new map, and the `last` time in any case. With
        anchors, walls are aligned by position, and the matcher is asked again only where too few stand as planned.
        `T_map_local` (4, 4) is the back end's estimate of the local frame, None where it has none.
        """
        walls = floor.walls
        self.log.rename(walls.current)
        self.commitment.rename(walls.current)
        alignment = self.alignment(scene, walls, T_map_local)
        share = 0.0 if alignment is None else alignment.share
        due = last or self.matching.is_due(scene.graph)
        if due and share < _LEAST_SHARE:
            before = self.committed
            self._ask(scene, walls, T_map_local, last)
            if before is not None and self.committed is before and alignment is None:
                self.withdraw(scene, "the walls no longer agree on a place in the plan")
            alignment = self.alignment(scene, walls, T_map_local)
        if alignment is None:
            return None
        statuses = anchor_statuses(alignment, scene, self.commitment.pairs, self._match_name)
        self.log.update(scene.graph.keyframes[-1].stamp_ns, statuses)
        anchors = self._anchors(scene, floor, alignment, T_map_local, statuses)
        self.commitment.replaced = False
        return anchors

    def confirm(self, scene: Scene, walls: WallMap, T_map_local: Floats | None) -> bool:
        """Matches the final map once more; returns whether the committed place is still probable, or there was none
        before or after. If it is not, the commitment is withdrawn."""
        was_committed = self.committed is not None
        self._ask(scene, walls, T_map_local, last=True)
        return (self.committed is not None) == was_committed and not self.commitment.replaced

    def follow(
        self, storey: str, scene: Scene, walls: WallMap, T_map_local: Floats, leading: "FloorAnchoring"
    ) -> bool:  # fmt: skip
        """Takes over the place of the `leading` floor on a storey; returns whether the walls agree with it."""
        own, confidence = self.commitment, leading.commitment.confidence
        probability = leading.matching.posterior.places[0].probability if leading.matching.posterior.places else 0.0
        own.match, own.follows = None, False
        place = own.place = own.place_now(walls, T_map_local)
        yaw, x, y = self._plan.T_a_s(place).tolist()
        reason = "its place follows from the floors above or below"
        own.match = match = MatchResult("unique", reason, T_a_s=(yaw, x, y), floor=storey)
        if self.aligned_share(scene, walls, T_map_local) < _LEAST_SHARE:
            own.match = None
            return False
        self.matching.take_over(match, scene, storey, probability)
        own.follows, own.pairs, own.other_confidence = True, set(), confidence
        return True

    def withdraw(self, scene: Scene, why: str) -> None:
        """Withdraws the commitment and its anchors, if there are any."""
        if self.committed is None:
            return
        self.commitment.clear()
        self.log.withdraw_all(scene.graph.keyframes[-1].stamp_ns, why)
        _log.warning("the match behind the anchors is withdrawn: %s", why)

    def aligned_share(self, scene: Scene, walls: WallMap, T_map_local: Floats | None) -> float:
        """The share of the walls that stand as planned; 0 where too few do, or they agree on no place."""
        alignment = self.alignment(scene, walls, T_map_local)
        return 0.0 if alignment is None or sum(w.agrees for w in alignment.walls) < _MIN_WALLS else alignment.share

    def alignment(self, scene: Scene, walls: WallMap, T_map_local: Floats | None) -> WallAlignment | None:
        """The walls of `scene` at planned ones; None where nothing is committed, or they agree on no place.

        `T_map_local` as in `update`.
        """
        if self.committed is None:
            return None
        place, origin = self.commitment.place_now(walls, T_map_local), self._plan.origin[:2]
        return align_walls(scene, walls, self.storey, origin, place, self._config.anchors)

    def answer(self, scene: Scene, alignment: WallAlignment | None) -> Mapping[str, Any] | None:
        """The answer in the form of matches.json, by the ids of `scene`.

        It is the committed one where there is one, without the pairs that the walls' positions contradict and with
        those that they add.
        """
        if self.committed is None or alignment is None:
            return None if self.match is None else self.match.to_dict()
        about_scene = self.committed is self.match and self.matching.scene is scene
        given = {s: (a, c) for s, a, c in self.committed.wall_surfaces} if about_scene else {}
        least = self.commitment.confidence
        surfaces = []
        for aligned in alignment.walls:
            a_id, confidence = given.get(aligned.surface.id, (aligned.planned.id, least))
            if aligned.agrees or aligned.surface.id in given or not about_scene:
                confidence = confidence if a_id == aligned.planned.id else least
                surfaces.append([aligned.surface.id, aligned.planned.id, confidence])
        rooms = matched_rooms(alignment.walls, self.committed.rooms if about_scene else (), least)
        return {**self.committed.to_dict(), "rooms": rooms, "wall_surfaces": surfaces}

    @property
    def _match_name(self) -> str:
        return f"match {self.matching.count}"

    def commit_to(self, chosen: Place, scene: Scene, walls: WallMap) -> None:
        """Commits to one of the places of the newest answer, which the other floors make sure, if its walls agree."""
        placed = self.matching.placed_at(chosen, scene, walls)
        if placed is not None:
            self.commitment.commit(*placed, scene)

    def _ask(self, scene: Scene, walls: WallMap, T_map_local: Floats | None, last: bool) -> None:
        """Asks the matcher and commits to a sure answer.

        An answer that places the map elsewhere replaces the committed one; a committed place that is no longer
        probable is withdrawn. A place that follows from another floor is that floor's to change.
        """
        matching, own, settings = self.matching, self.commitment, self._config.anchors
        matching.ask(scene, last)
        placed = matching.placed_at(matching.posterior.places[0], scene, walls) if matching.is_sure else None
        if self.committed is not None:
            here, floor = own.place_now(walls, T_map_local), own.floor
            elsewhere = placed is not None and (placed[0].floor != floor or differ(placed[1], here, scene.graph))
            probable = matching.posterior.at(self._plan.T_a_s(here), floor, scene.graph) >= settings.withdraw
            if own.follows and (elsewhere or placed is None):
                return
            if elsewhere:
                self.withdraw(scene, f"{self._match_name} places the map elsewhere")
                own.replaced = True
            elif placed is None and not probable:
                self.withdraw(scene, self.reason)
        if placed is not None:
            own.commit(*placed, scene)

    def _anchors(
        self, scene: Scene, floor: FloorMap, alignment: WallAlignment, T_map_local: Floats | None,
        statuses: dict[Key, AnchorStatus],
    ) -> Anchors:  # fmt: skip
        settings, (yaw, x, y), walls = self._config.anchors, alignment.place, floor.walls
        heights = self._heights(floor, alignment)
        T_local_level = se2_to_se3(yaw, x, y, self.height if heights is None else heights.raised)
        planned, by_rooms = planned_walls(alignment, scene, statuses, T_local_level, self._plan.origin)
        place = self.commitment.place_now(walls, T_map_local)
        moved = self.commitment.replaced or differ(alignment.place, place, scene.graph, _MOVED)
        if T_map_local is not None and heights is not None:
            z = float(inverse(walls.T_level_map @ T_map_local)[2, 3])
            moved = moved or abs(z - heights.raised) > ALIKE
        if T_map_local is None or moved:
            T_map_local = inverse(T_local_level @ walls.T_level_map)
        rooms = room_anchors(scene, by_rooms, self.height) if settings.rooms else {}
        elevations = {} if heights is None else heights.planned
        planes = planned if settings.planes else {}
        return Anchors(T_map_local, planes, rooms, elevations, self._match_name)

    def _heights(self, floor: FloorMap, alignment: WallAlignment) -> LevelAlignment | None:
        """The level surfaces of the floor in the plan; None where they, or the plan, do not show its height."""
        levels, planned = floor.levels.levels(floor.walls.T_level_map), self._plan.levels(self.commitment.floor)
        T_bim_level = se2_to_se3(*self._plan.T_a_s(alignment.place).tolist())
        return align_levels(levels, planned, T_bim_level, float(self._plan.origin[2]), self._config.anchors)
