"""The algorithm: from scans to an S-graph, matched with and anchored to a plan, and a trajectory in the BIM frame."""

import logging
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph, UserError
from data.plans import Bim
from matching.protocol import AnyMatcher
from sgslam.anchoring import AnchorRecord
from sgslam.config import Config
from sgslam.loops import LoopCloser
from sgslam.mapping import KeyframeClouds
from sgslam.odometry import Odometry
from sgslam.perception import RawScan, checked_scan
from sgslam.session import PriorMap, Result, Session, Snapshot, Stopwatch, Update
from sgslam.session.finishing import assemble_result
from sgslam.session.snapshot import take_snapshot
from sgslam.tracking import KidnapDetector
from sgslam.tracking.kidnap import all_fit

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
_KIDNAP_SCANS = 3  # consecutive scans that do not fit the previous ones: the sensor was carried elsewhere


class SceneGraphSlam:
    """SLAM with an S-graph, anchored to a building's A-graph if one is given.

    `bim` is an A-graph in the BIM frame or the result of `load_bim`; `matcher` is any object with `.match(s, a)`;
    `odometry` is any `Odometry` (default: KISS-ICP); `clouds` stores the keyframes' points (default: an anonymous
    temporary file). `prior` is the map of earlier runs: the run is relocalised in it, wherever it starts, and merged
    into it at the end; everything is then in that map's frame. `storey` is the name or id of the A-graph's floor on
    which the run begins; raises UserError if it does not exist. `stopwatch` measures the stages. Scans are added in the
    order of their stamps.
    """

    def __init__(
        self, bim: SceneGraph | Bim | None = None, matcher: AnyMatcher | None = None, config: Config | None = None,
        odometry: Odometry | None = None, clouds: KeyframeClouds | None = None, prior: PriorMap | None = None,
        storey: str | None = None, stopwatch: Stopwatch | None = None,
    ) -> None:  # fmt: skip
        config = config or Config()
        a_graph = bim.graph if isinstance(bim, Bim) else bim
        clouds = KeyframeClouds(None, config.clouds.keyframe_voxel) if clouds is None else clouds
        self._config, self._stopwatch = config, stopwatch or Stopwatch()
        self._session = Session(config, a_graph, matcher, odometry, prior, storey)
        self._map = self._session.begin(clouds, self._stopwatch)
        self._kidnap_detector = KidnapDetector()
        self._held_back: list[RawScan] = []  # the newest scans, while they do not fit the ones before
        self._newest_ns: int | None = None

    def add_scan(
        self,
        stamp_ns: int,
        points: NDArray[np.floating[Any]],
        point_times: Floats | None = None,
        T_odom_sensor: Floats | None = None,
    ) -> Update:
        """Adds one scan: its stamp in nanoseconds and its points (N, 3) in metres, in the sensor frame.

        `point_times` (N,) are seconds after the stamp; if given, the scan is deskewed. `T_odom_sensor` (4, 4), if
        given, replaces the built-in odometry for this scan. Raises UserError for stamps that do not increase, points or
        times that are not finite, and a `T_odom_sensor` that is not a rigid motion; the run goes on without that scan.

        If several consecutive scans do not fit the previous ones, the sensor was carried elsewhere: a new map begins,
        until it is relocalised in the old map or in the building.
        """
        checked = checked_scan(stamp_ns, points, T_odom_sensor, self._newest_ns)
        self._newest_ns = int(stamp_ns)
        return self._process(RawScan(int(stamp_ns), checked, point_times, T_odom_sensor))

    def _process(self, raw: RawScan, trusted: bool = False) -> Update:
        """Processes one scan; a `trusted` one skips the kidnap test."""
        current = self._map
        with self._stopwatch("odometry"):
            scan = current.tracker.prepare(raw)  # deskewed to one instant, sorted into columns
            suspect = not (trusted or current.tracker.between_floors or self._kidnap_detector.fits(scan.columns))
        if suspect:
            return self._hold_back(raw)
        if not trusted:
            self._process_held_back()
        with self._stopwatch("odometry"):
            self._kidnap_detector.keep(scan.columns)
            located = current.tracker.locate(scan, current.last_pose)  # predicted, aligned to walls and floor
        if current.add_scan(scan, located):
            current.add_keyframe(scan.points)  # with the walls and floor extracted from it
            if current.has_grown:
                current.update()  # matches and anchors, optimises, closes loops, segments rooms
        return self._update(raw.stamp_ns, scan.offset_ns)

    def _hold_back(self, raw: RawScan) -> Update:
        """Holds back scans that do not fit the previous ones, until it is clear whether this is a kidnap."""
        self._held_back.append(raw)
        if len(self._held_back) < _KIDNAP_SCANS:
            return self._update(raw.stamp_ns)
        held_back, self._held_back = self._held_back, []
        if all_fit([self._map.tracker.front_end.columns(one.points) for one in held_back]):
            _log.warning("scan at %d ns: the sensor was carried elsewhere; a new map begins", held_back[0].stamp_ns)
            self._map = self._session.split(self._map)
            self._kidnap_detector = KidnapDetector()
        return [self._process(one, trusted=True) for one in held_back][-1]

    def _process_held_back(self) -> None:
        """Processes the scans that were held back: they were no kidnap."""
        while self._held_back:
            self._process(self._held_back.pop(0), trusted=True)

    def _update(self, stamp_ns: int, offset_ns: int = 0) -> Update:
        newest = self._map.scans[-1].T_map_sensor
        live = self._map.tracker.live(newest, offset_ns)
        return Update(stamp_ns, live, len(self._map.backend.keyframes), self.anchored)

    def finish(self) -> Result:
        """Matches and optimises for the last time. Raises UserError if no scan was added."""
        if not self._map.scans:
            raise UserError("no scan was added, so there is no result; call add_scan first")
        self._process_held_back()
        relocalisation = self._session.finish(self._map)
        return assemble_result(self._map, self._session.bim, self._session.unplaced, relocalisation, self._config)

    @property
    def anchored(self) -> bool:
        """Whether the S-graph is anchored to the BIM."""
        return not self._map.plan_is_prior and self._map.placed

    @property
    def T_bim_map(self) -> Floats | None:  # noqa: N802
        """(4, 4) the current pose of the map in the BIM frame; None while it is not anchored."""
        return self._map.T_bim_map

    @property
    def T_prior_map(self) -> Floats | None:  # noqa: N802
        """(4, 4) the current pose of the map in the prior map's frame; None while it is not relocalised there."""
        return self._session.T_prior_map(self._map)

    @property
    def anchors(self) -> tuple[AnchorRecord, ...]:
        """All anchors so far, including withdrawn ones."""
        return () if self._map.anchoring is None else self._map.anchoring.records

    @property
    def clouds(self) -> KeyframeClouds:
        """The keyframes' points of the active map."""
        return self._map.clouds

    @property
    def keyframes(self) -> int:
        """The number of keyframes so far, up to the first kidnap."""
        prior = self._session.prior
        return len((prior.backend if self._session.kidnaps and prior is not None else self._map.backend).keyframes)

    @property
    def kidnaps(self) -> int:
        """How often so far the sensor was found to have been carried elsewhere."""
        return self._session.kidnaps

    @property
    def loops(self) -> LoopCloser:
        """The loop closures, including withdrawn ones."""
        return self._map.loops

    @property
    def seconds(self) -> dict[str, float]:
        """The time of each stage so far."""
        return self._stopwatch.seconds

    def s_graph(self) -> SceneGraph:
        """The current S-graph in the map frame.

        Rooms, wall surfaces and doors are segmented for it, which takes some tens of milliseconds and does not affect
        the run. Raises UserError before the first scan.
        """
        if not self._map.scans:
            raise UserError("no scan was added, so there is no graph yet; call add_scan first")
        return self._map.s_graph()

    def snapshot(self) -> Snapshot:
        """The current state, for viewers. Raises ValueError before the first scan."""
        return take_snapshot(self._map.backend, self._map.floors, self._map.anchoring, self._map.clouds)

    def state(self) -> dict[str, Any]:
        """The complete state as a tree (see `state_tree`), without the keyframes' points, which `clouds` stores.

        It is not a copy: write it before the next scan is added.
        """
        return {
            "newest_ns": self._newest_ns, "held_back": self._held_back, "seconds": self.seconds,
            "kidnap_detector": self._kidnap_detector.state(), "session": self._session.state(),
            "map": self._map.state(),
        }  # fmt: skip

    def restore(self, state: dict[str, Any]) -> None:
        """Restores a tree that `state` returned, for the same building and settings; the run then continues bit by bit
        as the saved one would have. Raises KeyError, TypeError or ValueError if the tree does not fit."""
        clouds = self._session.restore(state["session"], self.clouds)
        self._map = self._session.begin(clouds, self._stopwatch)
        self._map.restore(state["map"])
        self._kidnap_detector.restore(state["kidnap_detector"])
        self._newest_ns, self._held_back = state["newest_ns"], state["held_back"]
        self._stopwatch.seconds = state["seconds"]
