"""What a run remembers beside the map that it builds now: the prior map, and parts that nobody could place yet."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph
from matching.protocol import AnyMatcher
from sgslam.anchoring.building_anchoring import BuildingAnchoring
from sgslam.anchoring.default_matcher import default_matcher
from sgslam.anchoring.storey_hypotheses import floor_named
from sgslam.config import Config
from sgslam.geometry.frames import inverse
from sgslam.loops.closure import LoopCloser
from sgslam.mapping.keyframe_clouds import KeyframeClouds
from sgslam.odometry import Odometry, make_odometry
from sgslam.session.active_map import ActiveMap
from sgslam.session.prior_map import PriorMap, plan_of
from sgslam.session.result import Returned
from sgslam.session.stopwatch import Stopwatch

Floats = NDArray[np.float64]


class Session:
    """Begins maps, and joins them to the `prior` one. `kidnaps` counts the times that the sensor was carried elsewhere:
    the map up to the first is the prior map from then on, where there was none. `unplaced` are parts of the run of
    which nobody knows where they are. `storey` is the name or id of the floor on which the run begins."""

    def __init__(
        self, config: Config, bim: SceneGraph | None, matcher: AnyMatcher | None, odometry: Odometry | None,
        prior: PriorMap | None, storey: str | None,
    ) -> None:  # fmt: skip
        self._config, self.bim, self._matcher = config, bim, matcher
        self._given_odometry = odometry
        self._start = None if storey is None or bim is None else floor_named(bim, storey).id
        self.prior = prior
        self.kidnaps = 0
        self.unplaced: list[PriorMap] = []

    def begin(self, clouds: KeyframeClouds, stopwatch: Stopwatch) -> ActiveMap:
        """A new map, which is to be found in the prior one or in the building. An odometry of ours begins anew; another
        one finds its track again by itself."""
        plan, is_prior = (self.bim, False) if self.prior is None else plan_of(self.prior, self.bim)
        odometry = self._given_odometry or make_odometry(self._config.odometry)
        return ActiveMap(self._config, odometry, self._anchored_in(plan, is_prior), clouds, stopwatch)

    def part(self, ended: ActiveMap) -> ActiveMap:
        """The sensor was carried elsewhere: what was mapped up to now is prior from now on, and a new map begins."""
        ended.complete()
        T_prior_map, own = self.T_prior_map(ended), _as_prior(ended)
        if self.prior is None:
            self.prior = own
        elif T_prior_map is not None:
            self.prior.join(own, T_prior_map, self._config, same_run=self._prior_is_of_this_run)
        else:
            self.unplaced.append(own)
        self.kidnaps += 1
        return self.begin(KeyframeClouds(None, ended.clouds.voxel), ended.stopwatch)

    def finish(self, ended: ActiveMap) -> Returned | None:
        """Completes the map and joins it to the prior one, if it was found in it; the building then holds both. Returns
        what became of that, None where there is no prior map."""
        ended.complete()
        if self.prior is None:
            return None
        T_prior_map, found_ns = self.T_prior_map(ended), ended.first_anchor_ns
        reason = "" if ended.anchoring is None else ended.anchoring.reason
        began_ns, of_this_run = ended.scans[0].stamp_ns, self._prior_is_of_this_run
        if T_prior_map is not None:
            self.prior.join(_as_prior(ended), T_prior_map, self._config, same_run=of_this_run)
        elif of_this_run:  # what was before the sensor was carried away is what is known, and nothing harms it
            self.unplaced.append(_as_prior(ended))
        if T_prior_map is not None or of_this_run:
            self._take_over(ended, self.prior)
        elif not ended.plan_is_prior or self.bim is None:
            return Returned(False, None, reason)
        ended.anchoring = self._anchored_in(self.bim, is_prior=False)
        ended.complete()
        if T_prior_map is None or found_ns is None:
            return Returned(False, None, reason)
        return Returned(True, (found_ns - began_ns) / 1e9, reason)

    def T_prior_map(self, active: ActiveMap) -> Floats | None:  # noqa: N802
        """(4, 4) a map in the frame of the prior one, as it is known now; None where it was not found in it yet."""
        T_plan_map, prior = active.T_plan_map, self.prior
        if prior is None or T_plan_map is None:
            return None
        T_plan_prior = prior.T_plan_map if prior.T_bim_map is None or active.plan_is_prior else prior.T_bim_map
        return np.asarray(inverse(T_plan_prior) @ T_plan_map)

    @property
    def _prior_is_of_this_run(self) -> bool:
        return self.kidnaps > len(self.unplaced)

    def _take_over(self, ended: ActiveMap, prior: PriorMap) -> None:
        """The joined map in place of the one that ended, with the parts that can be placed in it."""
        self.unplaced = prior.merge_unplaced(self.unplaced, self.bim, self._matcher_in_use, self._config)
        ended.backend, ended.floors, ended.clouds = prior.backend, prior.floors, prior.clouds
        ended.scans, ended.begins = prior.scans, prior.begins
        ended.loops = LoopCloser(self._config.loops, prior.backend.closures, len(prior.backend.keyframes))

    @property
    def _matcher_in_use(self) -> AnyMatcher:
        return self._matcher or default_matcher(self._config)

    def _anchored_in(self, plan: SceneGraph | None, is_prior: bool) -> BuildingAnchoring | None:
        if plan is None:
            return None
        start = self._start if self.prior is None else None  # a prior map has floors of its own
        return BuildingAnchoring(plan, self._matcher_in_use, self._config, start, partial=is_prior)

    def state(self) -> dict[str, Any]:
        """All that it knows, as a tree (see `state_tree`). A prior map that was given is not of the run's state."""
        return {
            "kidnaps": self.kidnaps, "unplaced": [part.state() for part in self.unplaced],
            "prior": self.prior.state() if self.prior is not None and self.kidnaps else None,
        }  # fmt: skip

    def restore(self, state: dict[str, Any], clouds: KeyframeClouds) -> KeyframeClouds:
        """Goes on from what `state` told; returns where the active map's points go. `clouds` are those that were kept:
        the points of what came after the sensor was first carried away are not."""
        if state["prior"] is not None:
            self.prior, clouds = PriorMap.restored(state["prior"], self._config, clouds), _no_clouds(clouds)
        self.unplaced = [PriorMap.restored(told, self._config, _no_clouds(clouds)) for told in state["unplaced"]]
        self.kidnaps = state["kidnaps"]
        return clouds


def _no_clouds(like: KeyframeClouds) -> KeyframeClouds:
    return KeyframeClouds(None, like.voxel)


def _as_prior(ended: ActiveMap) -> PriorMap:
    height, T_bim_map = ended.tracker.front_end.height, ended.T_bim_map
    return PriorMap(ended.backend, ended.floors, ended.scans, ended.begins, height, T_bim_map, ended.clouds)
