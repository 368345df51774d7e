"""Matching one floor of the S-graph: what the matcher is asked, and the posterior of the floor's place that follows."""

import logging
from collections.abc import Collection
from dataclasses import replace

import numpy as np

from data import SceneGraph
from data.scene_graph.graph import mirrored
from matching.result import AnyMatcher, MatchResult
from sgslam.anchoring.free_space_conflict import conflict_share
from sgslam.anchoring.place_posterior import Place, PlacePosterior, in_known_map, place_posterior
from sgslam.anchoring.plan import Plan
from sgslam.anchoring.soundness import known_map
from sgslam.config import AnchorSettings
from sgslam.mapping import Scene

_log = logging.getLogger(__name__)
MIRRORED_REASON = (
    "the mirror image of the map fits the plan better: are the scans mirrored? A sensor that is upside down needs "
    "--mount 180,0,0; leave it out for one that is upright"
)
STOREY_REASON = "storey '{}' of the plan explains the map better than the one that was given; check --storey"
HEIGHT_REASON = "the height between the floors rules out its storey"


class FloorMatching:
    """Asks the matcher about one floor and remembers its answer.

    `match` is the newest answer, `scene` the map it is about, `posterior` what follows from it, and `reason` why it is
    accepted, or why it is not; empty before the first. `count` is the number of answers.
    """

    def __init__(self, plan: Plan, matcher: AnyMatcher, settings: AnchorSettings) -> None:
        self._plan, self._matcher, self._settings = plan, matcher, settings
        self._storeys: Collection[str] = ()
        self._is_stated = False  # whether the user states the storey
        self.match: MatchResult | None = None
        self.scene: Scene | None = None
        self.posterior = PlacePosterior()
        self.reason = ""
        self.count = 0

    def restrict_storeys(self, storeys: Collection[str], is_stated: bool) -> None:
        """Sets the storeys that this floor can be, all where none is given, and whether the user states them."""
        self._storeys, self._is_stated = storeys, is_stated and bool(storeys)

    def take_over(self, match: MatchResult, scene: Scene, probability: float) -> None:
        """Makes an answer that follows from other floors, with its probability, the newest one."""
        self.match, self.scene, self.reason = match, scene, match.reason
        assert match.T_a_s is not None
        self.posterior = PlacePosterior((Place(match.T_a_s, match.floor, probability),))

    def is_due(self, graph: SceneGraph) -> bool:
        """Whether the map is another one than that which was matched."""
        return self.scene is None or len(graph.keyframes) != len(self.scene.graph.keyframes)

    def ask(self, scene: Scene, last: bool) -> None:
        """Matches the floor with the plan.

        The mirror image is matched too where it could change what is decided: where the answer would be sure without
        it, and the `last` time, for the reason in the report.
        """
        s = scene.graph
        self.match, self.scene = self._matched(s), scene
        self.count += 1
        _log.info("match %d, of %d rooms: %s, %s", self.count, len(s.rooms), self.match.status, self.match.reason)
        self.posterior = self._posterior(self.match, None, s)
        if last or self.is_sure:
            self.posterior = self._posterior(self.match, self._matched(mirrored(s)), s)
        self.reason = self.match.reason
        if why := self._why_not(self.match):
            self.reject(why)

    @property
    def is_sure(self) -> bool:
        """Whether the best place may be committed to; a storey that the user excludes is never taken."""
        probability, storey = self.posterior.two_best[0]
        return probability >= self._settings.commit and (not self._is_stated or storey in self._storeys)

    def settle(self, chosen: Place) -> MatchResult:
        """Makes the newest answer unique, at a chosen one of its places; the pairs are those of the best place."""
        assert self.match is not None
        is_best = (self.match.T_a_s, self.match.floor) == (chosen.T_a_s, chosen.floor)
        match = self.match if is_best else replace(self.match, rooms=(), wall_surfaces=())
        self.match = replace(match, status="unique", T_a_s=chosen.T_a_s, floor=chosen.floor)
        return self.match

    def reject(self, why: str) -> None:
        """Rejects the newest answer."""
        self.reason = why
        _log.info("match %d is rejected: %s", self.count, why)

    def _matched(self, s: SceneGraph) -> MatchResult:
        return self._matcher.match(s, self._plan.a_graph)

    def _posterior(self, match: MatchResult, image: MatchResult | None, s: SceneGraph) -> PlacePosterior:
        found = place_posterior(match, image, self._storeys, self._plan.count)
        if not self._plan.partial or not found.places:
            return found
        best = found.places[0]
        conflict = conflict_share(s, self._plan.storey(best.floor), np.array(best.T_a_s))
        return in_known_map(found, conflict, known_map())

    def _why_not(self, match: MatchResult) -> str:
        """Why an answer that is unique for the matcher is not sure; empty where its own reason says it."""
        posterior = self.posterior
        if self.is_sure or not match.hypotheses:
            return ""
        if posterior.mirrored > max(1 - self._settings.commit, posterior.outside):
            return MIRRORED_REASON
        favoured = match.hypotheses[0].floor
        _, likeliest = posterior.two_best[0]
        if self._is_stated and likeliest is not None and likeliest not in self._storeys and match.status != "none":
            names = {floor.id: floor.name for floor in self._plan.a_graph.floors}
            return STOREY_REASON.format(names.get(likeliest) or likeliest)
        if match.status != "unique":
            return ""
        if self._storeys and favoured not in self._storeys:
            return HEIGHT_REASON
        return f"the best place has a probability of {100 * posterior.places[0].probability:.1f} %, which is too little"
