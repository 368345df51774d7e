"""The maps of a run: begins a map, merges it with the prior map, keeps submaps that are not relocalised yet."""

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from matching import Matcher
from matching.result import AnyMatcher
from sgslam.anchoring import BuildingAnchoring, floor_named
from sgslam.config import Config
from sgslam.geometry.frames import inverse
from sgslam.loops import LoopCloser
from sgslam.mapping import KeyframeClouds
from sgslam.session.active_map import ActiveMap
from sgslam.session.prior_map import PriorMap
from sgslam.session.stopwatch import Stopwatch
from sgslam.types import Relocalisation

Floats = NDArray[np.float64]


class Session:
    """Begins maps and merges them into the `prior` map.

    `kidnaps` counts how often the sensor was carried elsewhere. If there is no prior map, the map up to the first
    kidnap becomes it. `unplaced` are submaps of the run that are not relocalised. `storey` is the name or id of the
    floor on which the run begins. Raises UserError for a storey that the plan does not have.
    """

    def __init__(
        self,
        config: Config,
        bim: SceneGraph | None,
        matcher: AnyMatcher | None,
        prior: PriorMap | None,
        storey: str | None,
    ) -> None:
        self._config, self.bim, self.matcher = config, bim, matcher
        self._start = None if storey is None or bim is None else floor_named(bim, storey).id
        self.prior = prior
        self.kidnaps = 0
        self.unplaced: list[PriorMap] = []
        self._relocalisation: Relocalisation | None = None  # once the run has finished

    def begin(self, clouds: KeyframeClouds, stopwatch: Stopwatch) -> ActiveMap:
        """A new map, to be relocalised in the prior map or anchored to the building."""
        plan, _, is_prior = (self.bim, None, False) if self.prior is None else self.prior.plan_in(self.bim)
        return ActiveMap(self._config, self._anchored_in(plan, is_prior), clouds, stopwatch)

    def split(self, ended: ActiveMap) -> ActiveMap:
        """Begins a new map after the sensor was carried elsewhere; the ended map becomes or joins the prior map."""
        ended.complete()
        part = PriorMap.of(ended)
        if self.prior is None:
            self.prior = part
        elif not self._joined(self.prior, part, self.T_prior_map(ended)):
            self.unplaced.append(part)
        self.kidnaps += 1
        return self.begin(KeyframeClouds(None, ended.clouds.voxel), ended.stopwatch)

    def finish(self, ended: ActiveMap) -> Relocalisation | None:
        """Completes the map, merges it with the prior map if it was relocalised there, and anchors the merged map to
        the building. Returns the outcome of the relocalisation, None without a prior map."""
        ended.complete()
        if self.prior is None or ended.backend is self.prior.backend:
            return self._relocalisation
        self._relocalisation = self._join(ended)
        return self._relocalisation

    def _join(self, ended: ActiveMap) -> Relocalisation:
        """Merges a completed map with the prior map, and anchors both."""
        assert self.prior is not None
        T_prior_map, found_ns, newest = self.T_prior_map(ended), ended.first_anchor_ns, PriorMap.of(ended)
        reason = "" if ended.anchoring is None else ended.anchoring.reason
        began_ns, of_this_run = ended.scans[0].stamp_ns, self._prior_is_of_this_run
        is_joined = self._joined(self.prior, newest, T_prior_map)
        if of_this_run and not is_joined:  # the map from before the kidnap is the result; the submap stays apart
            self.unplaced.append(newest)
        if is_joined or of_this_run:
            self._adopt_prior(ended, self.prior)
        elif not ended.plan_is_prior or self.bim is None:
            return Relocalisation(False, None, reason)
        self._anchor(ended)
        if of_this_run and ended.T_bim_map is not None and self.prior.first_anchor_ns is not None:
            ended.first_anchor_ns = self.prior.first_anchor_ns  # the place that it had before is found again
        if of_this_run and ended.T_bim_map is None and (why := self._begin_with_another_part(ended)):
            is_found = newest not in self.unplaced
            return Relocalisation(is_found, None, why if is_found else reason)
        if T_prior_map is None or found_ns is None:
            return Relocalisation(False, None, reason)
        return Relocalisation(True, (found_ns - began_ns) / 1e9, reason)

    def _joined(self, prior: PriorMap, part: PriorMap, T_prior_part: Floats | None) -> bool:
        """Merges a map with the prior map where its place (4, 4) there is known; returns whether it is."""
        if T_prior_part is not None:
            prior.join(part, T_prior_part, self._config, same_run=self._prior_is_of_this_run)
        return T_prior_part is not None

    def _anchor(self, ended: ActiveMap) -> None:
        ended.anchoring = self._anchored_in(self.bim, is_prior=False)
        ended.complete()

    def _begin_with_another_part(self, ended: ActiveMap) -> str:
        """Makes a later part of the run the map, and says why: one that is in the building, where the first one is too
        small to tell, or the largest, where all scans of the first one are lost. The others join it where they can be
        placed. Empty where the first one stays."""
        assert self.prior is not None
        parts = sorted(self.unplaced, key=lambda part: -len(part.scans))
        for part in parts if self.bim is not None else ():
            part.T_bim_map = self._place_in(self.bim, part, is_prior=False)
            if part.T_bim_map is not None:
                self._begin_with(part, ended)
                return "found in the building after the last scan"
        if parts and all(scan.health == "lost" for scan in self.prior.scans):
            self._begin_with(parts[0], ended)
            return "all scans before it are lost"
        return ""

    def _begin_with(self, part: PriorMap, ended: ActiveMap) -> None:
        assert self.prior is not None
        self.unplaced = [other for other in (self.prior, *self.unplaced) if other is not part]
        self.prior = part
        self._adopt_prior(ended, part)
        self._anchor(ended)

    def T_prior_map(self, active: ActiveMap) -> Floats | None:  # noqa: N802
        """(4, 4) the current pose of a map in the frame of the prior map; None while it is not relocalised there."""
        T_plan_map, prior = active.T_plan_map, self.prior
        if prior is None or T_plan_map is None:
            return None
        T_plan_prior = prior.T_plan_map if prior.T_bim_map is None or active.plan_is_prior else prior.T_bim_map
        return np.asarray(inverse(T_plan_prior) @ T_plan_map)

    @property
    def _prior_is_of_this_run(self) -> bool:
        return self.kidnaps > len(self.unplaced)

    def _adopt_prior(self, ended: ActiveMap, prior: PriorMap) -> None:
        """Replaces the ended map by the merged prior map, after merging the submaps that can be placed in it."""
        tried: list[PriorMap] = []
        while len(tried) != len(self.unplaced):  # the map has grown since
            tried, self.unplaced = self.unplaced, []
            for part in tried:
                plan, T_plan_prior, is_prior = prior.plan_in(self.bim)
                T_plan_part = self._place_in(plan, part, is_prior)
                if T_plan_part is None:
                    self.unplaced.append(part)
                else:
                    prior.join(part, inverse(T_plan_prior) @ T_plan_part, self._config, same_run=True)
        ended.backend, ended.floors, ended.clouds = prior.backend, prior.floors, prior.clouds
        ended.scans, ended.begins = prior.scans, prior.begins
        ended.loops = LoopCloser(self._config.loops, prior.backend.closures, len(prior.backend.keyframes))

    def _place_in(self, plan: SceneGraph | None, part: PriorMap, is_prior: bool) -> Floats | None:
        """(4, 4) a part of the run in the frame of a plan, None if it has no one place there. A plan that `is_prior`
        may lack rooms."""
        assert plan is not None
        anchoring = BuildingAnchoring(plan, self._matcher_for(is_prior), self._config, partial=is_prior)
        anchors = anchoring.update(part.floors, None, last=True)
        return None if anchors is None else anchoring.bim_from_map(anchors.T_map_local)

    @property
    def matcher_in_use(self) -> AnyMatcher:
        """The given matcher, or that of the settings."""
        self.matcher = self.matcher or Matcher.load(self._config.matching.method)
        return self.matcher

    def _matcher_for(self, is_prior: bool) -> AnyMatcher:
        """That in use; in the map of an earlier run without the judge, since it was trained on plans, which lack no
        rooms, and how probable a place there is was fitted to the evidence alone (`in_known_map`)."""
        if is_prior and isinstance(self.matcher_in_use, Matcher):
            return self.matcher_in_use.without_judge()
        return self.matcher_in_use

    def _anchored_in(self, plan: SceneGraph | None, is_prior: bool) -> BuildingAnchoring | None:
        if plan is None:
            return None
        start = self._start if self.prior is None else None  # a prior map has floors of its own
        return BuildingAnchoring(plan, self._matcher_for(is_prior), self._config, start, partial=is_prior)
