"""What can be asked of a run at any time: its poses in all frames, its map and anchors; and its state."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph, UserError
from data.trajectory import Trajectory
from sgslam.anchoring import AnchorRecord
from sgslam.anchoring.place_posterior import PlacePosterior
from sgslam.config import Config
from sgslam.mapping import KeyframeClouds
from sgslam.serialization import pack, unpack
from sgslam.session.active_map import ActiveMap
from sgslam.session.scan_poses import ScanPose, at_stamps
from sgslam.session.session import Session
from sgslam.session.snapshot import Snapshot
from sgslam.session.soundness.scan_uncertainty import live_sigma
from sgslam.session.stopwatch import Stopwatch
from sgslam.tracking import RunTracker

Floats = NDArray[np.float64]


class RunState:
    """The parts of a run: its tracker, its maps, of which one is active, and what they show."""

    _config: Config
    _stopwatch: Stopwatch
    _tracking: RunTracker
    _session: Session
    _map: ActiveMap
    _clouds: KeyframeClouds  # up to the first kidnap

    @property
    def anchored(self) -> bool:
        """Whether the S-graph is anchored to the BIM."""
        return self.T_bim_map is not None

    @property
    def place_probabilities(self) -> tuple[float, float]:
        """The probability of the map's best place in its plan when it was last matched, and that of the runner-up."""
        anchoring = self._map.anchoring
        (best, _), (other, _) = (PlacePosterior() if anchoring is None else anchoring.posterior).two_best
        return best, other

    @property
    def T_bim_map(self) -> Floats | None:  # noqa: N802
        """(4, 4) the current pose of the map in the BIM frame; None while it is not anchored."""
        return self._map.T_bim_map

    def live_poses(self, since_ns: int) -> Trajectory:
        """T_map_sensor of the active map's scans from a stamp on, as estimated when each was added; without scans that
        wait or are lost."""
        scans = [scan for scan in self._map.scans if scan.stamp_ns >= since_ns]
        return at_stamps(scans, np.array([scan.T_map_sensor for scan in scans]).reshape(-1, 4, 4))

    def sigma(self) -> Floats:
        """(6,) the standard deviations of the newest pose: along x, y, z (m) and about them (rad), in the BIM frame if
        the map is anchored, otherwise in the map frame. NaN before the first optimisation and while scans wait.

        It takes as long as an optimisation, a few to some tens of milliseconds, and does not affect the run.
        """
        current, settings = self._map, self._config.odometry
        if not current.scans or self._tracking.waiting is not None:
            return np.full(6, np.nan)
        newest = current.scans[-1]
        T_map_sensor, covariance = newest.T_map_sensor, newest.covariance
        if (held := self._tracking.held) is not None:
            T_map_sensor, covariance = current.T_map_odom @ held.T_odom_sensor, held.covariance
        return live_sigma(current, T_map_sensor, covariance, settings)

    @property
    def T_map_odom(self) -> Floats:  # noqa: N802
        """(4, 4) the correction of the tracker's poses by the map, the plan and loops, at the newest keyframe."""
        return self._map.T_map_odom

    @property
    def newest(self) -> ScanPose | None:
        """The newest scan in the map; None before the first, and while the first ones wait."""
        return self._map.scans[-1] if self._map.scans else None

    @property
    def T_prior_map(self) -> Floats | None:  # noqa: N802
        """(4, 4) the current pose of the map in the prior map's frame; None while it is not relocalised there."""
        return self._session.T_prior_map(self._map)

    @property
    def anchors(self) -> tuple[AnchorRecord, ...]:
        """All anchors so far, including withdrawn ones."""
        return () if self._map.anchoring is None else self._map.anchoring.records

    @property
    def keyframes(self) -> int:
        """The number of keyframes so far, up to the first kidnap."""
        prior = self._session.prior
        return len((prior.backend if self._session.kidnaps and prior is not None else self._map.backend).keyframes)

    @property
    def kidnaps(self) -> int:
        """How many times so far the sensor was carried elsewhere."""
        return self._session.kidnaps

    @property
    def seconds(self) -> dict[str, float]:
        """The time of each stage so far, in seconds."""
        return self._stopwatch.seconds

    def s_graph(self) -> SceneGraph:
        """The current S-graph in the map frame.

        This segments rooms, wall surfaces and doors, which takes some tens of milliseconds and does not affect the
        run. Empty while the first scans wait. Raises UserError before the first scan.
        """
        if self._tracking.newest_ns is None and not self._map.scans:
            raise UserError("no scan was added, so there is no graph yet; call add_scan first")
        return self._map.floors.graph(self._map.backend.keyframes, self._map.scenes_now())

    def snapshot(self) -> Snapshot:
        """The current state, for viewers."""
        return Snapshot.of(self._map)

    def state(self) -> dict[str, bytes]:
        """The complete state, of the tracker and of the map, without the keyframes' points, which `clouds` stores."""
        run = self._session, self._map, self.seconds
        return {"tracking": pack(self._tracking, self._config), "map": pack(run, self._config, **self._given)}

    def restore(self, state: dict[str, bytes]) -> None:
        """Restores what `state` returned, for the same building and settings; the run then continues bit by bit as the
        saved one would have. It lacks "tracking" where another process tracks. Raises ValueError for another building
        and for what is damaged."""
        given = {**self._given, "matcher": self._session.matcher_in_use}
        session, active, seconds = unpack(state["map"], self._config, **given)
        if session.bim is not self._session.bim:
            raise ValueError("of another building")
        self._session, self._map, self._stopwatch.seconds = session, active, seconds
        if "tracking" in state:
            self._tracking = unpack(state["tracking"], self._config)

    @property
    def _given(self) -> dict[str, Any]:
        """What a state names only."""
        session = self._session
        prior = None if session.kidnaps else session.prior  # it stays as it is until another map joins it
        given = {"bim": session.bim, "matcher": session.matcher, "prior": prior}
        return {**given, "clouds": self._clouds, "stopwatch": self._stopwatch}
