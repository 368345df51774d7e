"""Matching one floor of the S-graph: what the matcher is asked, and the posterior of the floor's place that follows."""

import logging

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from data.scene_graph.graph import mirrored
from matching.result import AnyMatcher, MatchResult
from sgslam.anchoring.free_space_conflict import conflict_share
from sgslam.anchoring.place_posterior import Place, PlacePosterior, in_known_map, place_posterior
from sgslam.anchoring.plan import Plan, match_at
from sgslam.anchoring.soundness import known_map
from sgslam.anchoring.wall_alignment import place_from_match
from sgslam.config import AnchorSettings
from sgslam.mapping import Scene, WallMap

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
MIRRORED_REASON = (
    "the mirror image of the map fits the plan better: are the scans mirrored? A sensor that is upside down needs "
    "--mount 180,0,0; leave it out for one that is upright"
)
STOREY_REASON = "storey '{}' of the plan explains the map better than the one that was given; check --storey"
HEIGHT_REASON = "the height between the floors rules out its storey"


class FloorMatching:
    """Asks the matcher about one floor and remembers its answer.

    `match` is the newest answer, `scene` the map it is about, `posterior` what follows from it, `rejection` the reason
    why it was not accepted, empty where the answer says it. Only `storey` is matched where it follows from other
    floors; `possible_storeys` are those that the heights between the floors allow, all where that list is empty.
    """

    def __init__(self, plan: Plan, matcher: AnyMatcher, settings: AnchorSettings) -> None:
        self._plan, self._matcher, self._settings = plan, matcher, settings
        self._stated: str | None = None  # the storey that follows from a statement of the user
        self.storey: str | None = None
        self.possible_storeys: list[str] = []
        self.match: MatchResult | None = None
        self.scene: Scene | None = None
        self.posterior = PlacePosterior()
        self.rejection = ""
        self.count = 0
        self._asked_at = 0  # keyframes of the map that the answer is about

    def restrict_storeys(self, storeys: list[str], stated: str | None) -> None:
        """Sets the storeys that this floor can be, all where the list is empty, and the one that the user states."""
        self.possible_storeys, self._stated = storeys, stated

    def take_over(self, match: MatchResult, scene: Scene, storey: str, probability: float) -> None:
        """Makes an answer that follows from other floors, with its probability, the newest one."""
        self.match, self.scene, self.storey, self.rejection = match, scene, storey, ""
        assert match.T_a_s is not None
        self.posterior = PlacePosterior((Place(match.T_a_s, storey, probability),))

    def is_due(self, graph: SceneGraph) -> bool:
        """Whether the map is another one than that which was matched."""
        return len(graph.keyframes) != self._asked_at

    def ask(self, scene: Scene, last: bool) -> None:
        """Matches the floor with the plan.

        The mirror image is matched too where it could change what is decided: where the answer would be sure without
        it, and the `last` time, for the reason in the report.
        """
        s, image = scene.graph, None
        self.match, self.scene, self._asked_at = self._matched(s), scene, len(s.keyframes)
        self.count += 1
        _log.info("match %d, of %d rooms: %s, %s", self.count, len(s.rooms), self.match.status, self.match.reason)
        self.posterior = self._posterior(self.match, None, s)
        if last or self.is_sure:
            image = self._matched(mirrored(s))
            self.posterior = self._posterior(self.match, image, s)
        self.rejection = self._why_not()
        if self.rejection:
            _log.info("match %d is rejected: %s", self.count, self.rejection)

    @property
    def is_sure(self) -> bool:
        """Whether the best place may be committed to; a storey that the user excludes is never taken."""
        best = next(iter(self.posterior.places), None)
        if best is None or best.probability < self._settings.commit:
            return False
        return best.floor == self._stated or self._stated is None

    def placed_at(self, chosen: Place, scene: Scene, walls: WallMap) -> tuple[MatchResult, Floats] | None:
        """The newest answer at a chosen one of its places, with the place (3,), T_local_level, on which its walls agree
        there; None if they do not."""
        assert self.match is not None
        storey = self._plan.storey(chosen.floor)
        match = match_at(chosen, self.match, scene.graph, storey, self._settings)
        by_id, origin = self._plan.a_graph.surface_by_id, self._plan.origin[:2]
        pairs = [(scene.graph.surface_by_id[s], by_id[a_id]) for s, a_id, _ in match.wall_surfaces]
        rough = np.array(chosen.T_a_s) - np.array([0.0, *origin])
        place = place_from_match(pairs, scene, walls, origin, rough, self._settings)
        if place is None:
            self.rejection = "its walls do not agree on a place"
            _log.info("match %d is rejected: %s", self.count, self.rejection)
            return None
        self.match = match
        return match, place

    def _matched(self, s: SceneGraph) -> MatchResult:
        return self._matcher.match(s, self._plan.storey(self.storey))

    def _posterior(self, match: MatchResult, image: MatchResult | None, s: SceneGraph) -> PlacePosterior:
        found = place_posterior(match, image, self._stated, self.possible_storeys)
        if not self._plan.partial or not found.places:
            return found
        best = found.places[0]
        conflict = conflict_share(s, self._plan.storey(best.floor), np.array(best.T_a_s))
        return in_known_map(found, conflict, known_map())

    def _why_not(self) -> str:
        """Why an answer that is unique for the matcher is not sure; empty where its own reason says it."""
        posterior, match = self.posterior, self.match
        if self.is_sure or match is None or not match.hypotheses:
            return ""
        if posterior.mirrored > max(1 - self._settings.commit, posterior.outside):
            return MIRRORED_REASON
        favoured = match.hypotheses[0].floor
        if self._stated is not None and favoured != self._stated and match.status != "none":
            stated = sum(p.probability for p in posterior.places if p.floor == self._stated)
            names = {floor.id: floor.name for floor in self._plan.a_graph.floors}
            if stated < self._settings.commit and favoured is not None:
                return STOREY_REASON.format(names.get(favoured) or favoured)
        if match.status != "unique":
            return ""
        if self.possible_storeys and favoured not in self.possible_storeys:
            return HEIGHT_REASON
        return f"the best place has a probability of {100 * posterior.places[0].probability:.1f} %, which is too little"
