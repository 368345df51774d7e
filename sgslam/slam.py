"""The algorithm: scans go in, the S-graph grows, is matched, is anchored; a trajectory in building coordinates comes
out."""

import logging
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph, UserError
from data.plans.bim import Bim
from matching.protocol import AnyMatcher
from sgslam.anchoring.anchor_log import AnchorRecord
from sgslam.config import Config
from sgslam.loops.closure import LoopCloser
from sgslam.mapping.keyframe_clouds import KeyframeClouds
from sgslam.odometry import Odometry
from sgslam.perception.scan_checks import RawScan, checked_scan
from sgslam.session.finishing import finished
from sgslam.session.prior_map import PriorMap
from sgslam.session.result import Result, Update
from sgslam.session.session import Session
from sgslam.session.snapshot import Snapshot, taken
from sgslam.session.stopwatch import Stopwatch
from sgslam.tracking.kidnap import KidnapDetector, all_fit

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
_UNLIKE = 3  # scans in a row that do not fit those before: the sensor was carried elsewhere


class SceneGraphSlam:
    """SLAM with an S-graph, anchored to a building's A-graph where one is given.

    `bim` is an A-graph in the BIM frame (or what `load_bim` gives), `matcher` any object with `.match(s, a)`,
    `odometry` any `Odometry` (KISS-ICP by default), `clouds` where the keyframes' points are kept (a nameless file by
    default). `prior` is the map of earlier runs, in which this one finds itself, wherever it starts, and to which it is
    joined at the end: all is in that map's frame then. Scans are added in the order of their stamps. `storey` is the
    name or the id of the A-graph's floor on which the run begins; raises UserError for one that there is not.
    `stopwatch` measures the stages.
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
        self._kidnap_watch = KidnapDetector()
        self._held_back: list[RawScan] = []  # the newest scans, where they cannot have been taken near the one before
        self._newest_ns: int | None = None

    def add_scan(
        self,
        stamp_ns: int,
        points: NDArray[np.floating[Any]],
        point_times: Floats | None = None,
        T_odom_sensor: Floats | None = None,
    ) -> Update:
        """Adds one scan: its stamp in nanoseconds, its points (N, 3) in metres, sensor frame.

        `point_times` (N,) are seconds after the stamp: with them the scan is deskewed. `T_odom_sensor` (4, 4) replaces
        our own odometry for it. Raises UserError for stamps that do not increase, for points and times that are not
        finite, and for a `T_odom_sensor` that is no rigid motion; the run goes on without that scan.

        Where scan after scan cannot have been taken near those before, the sensor was carried elsewhere: a new map is
        begun, in which the run goes on until it is found in the old one, or in the building.
        """
        checked = checked_scan(stamp_ns, points, T_odom_sensor, self._newest_ns)
        self._newest_ns = int(stamp_ns)
        return self._process(RawScan(int(stamp_ns), checked, point_times, T_odom_sensor))

    def _process(self, raw: RawScan, trusted: bool = False) -> Update:
        """The way of a scan. A `trusted` one is not asked whether it was taken elsewhere."""
        current = self._map
        with self._stopwatch("odometry"):
            scan = current.prepare(raw)  # deskewed to one instant, sorted into columns
            suspect = not (trusted or current.tracker.between_floors or self._kidnap_watch.fits(scan.columns))
        if suspect:
            return self._hold_back(raw)
        if not trusted:
            self._release()
        with self._stopwatch("odometry"):
            self._kidnap_watch.keep(scan.columns)
            located = current.locate(scan)  # predicted, aligned to walls and floor
        if current.add_scan(scan, located):
            current.add_keyframe(scan.points)  # with the walls and the floor that it shows
            if current.has_grown:
                current.update()  # optimises, closes loops, cuts rooms, matches and anchors
        return self._update(raw.stamp_ns, scan.offset_ns)

    def _hold_back(self, raw: RawScan) -> Update:
        """Waits with scans that do not fit those before, until it is clear that the sensor was carried elsewhere."""
        self._held_back.append(raw)
        if len(self._held_back) < _UNLIKE:
            return self._update(raw.stamp_ns)
        held_back, self._held_back = self._held_back, []
        if all_fit([self._map.tracker.front_end.columns(one.points) for one in held_back]):
            _log.warning("at %d ns the sensor was carried elsewhere: a new map begins", held_back[0].stamp_ns)
            self._map = self._session.part(self._map)
            self._kidnap_watch = KidnapDetector()
        return [self._process(one, trusted=True) for one in held_back][-1]

    def _release(self) -> None:
        """Takes the scans that were held back, which were only odd."""
        while self._held_back:
            self._process(self._held_back.pop(0), trusted=True)

    def _update(self, stamp_ns: int, offset_ns: int = 0) -> Update:
        newest = self._map.scans[-1].T_map_sensor
        live = self._map.tracker.live(newest, offset_ns)
        return Update(stamp_ns, live, len(self._map.backend.keyframes), self.anchored)

    def finish(self) -> Result:
        """Matches and optimises a last time; raises UserError where no scan was added."""
        if not self._map.scans:
            raise UserError("no scan was added: nothing to finish")
        self._release()
        returned = self._session.finish(self._map)
        return finished(self._map, self._session.bim, self._session.unplaced, returned, self._config)

    @property
    def anchored(self) -> bool:
        """Whether the S-graph is anchored to the BIM."""
        return not self._map.plan_is_prior and self._map.placed

    @property
    def T_bim_map(self) -> Floats | None:  # noqa: N802
        """(4, 4) the map in the BIM frame, as it is known now; None while it is not anchored."""
        return self._map.T_bim_map

    @property
    def T_prior_map(self) -> Floats | None:  # noqa: N802
        """(4, 4) the map in the frame of the prior one, as it is known now; None where it was not found in it yet."""
        return self._session.T_prior_map(self._map)

    @property
    def anchors(self) -> tuple[AnchorRecord, ...]:
        """The record of all anchors so far, those withdrawn too."""
        return () if self._map.anchoring is None else self._map.anchoring.records

    @property
    def clouds(self) -> KeyframeClouds:
        """The points of the keyframes of the map that is built now."""
        return self._map.clouds

    @property
    def keyframes(self) -> int:
        """How many there are so far, up to the first time that the sensor was carried elsewhere."""
        prior = self._session.prior
        return len((prior.backend if self._session.kidnaps and prior is not None else self._map.backend).keyframes)

    @property
    def loops(self) -> LoopCloser:
        """Which loops were closed, and which of them were opened again."""
        return self._map.loops

    @property
    def seconds(self) -> dict[str, float]:
        """What each stage has taken so far."""
        return self._stopwatch.seconds

    def s_graph(self) -> SceneGraph:
        """The S-graph as it is now, in the map frame: rooms, wall surfaces and doors are cut anew for it, which takes
        some tens of milliseconds and changes nothing in the run. Raises UserError before the first scan."""
        if not self._map.scans:
            raise UserError("no scan was added: there is no graph yet")
        return self._map.s_graph()

    def snapshot(self) -> Snapshot:
        """What is known now, for those who look on; raises ValueError before the first scan."""
        return taken(self._map.backend, self._map.floors, self._map.anchoring, self._map.clouds)

    def state(self) -> dict[str, Any]:
        """All that it knows but the keyframes' points, which `clouds` keep, as a tree (see `state_tree`). It is not a
        copy: write it before the next scan is added."""
        return {
            "newest_ns": self._newest_ns, "held_back": self._held_back, "seconds": self.seconds,
            "kidnap_watch": self._kidnap_watch.state(), "session": self._session.state(), "map": self._map.state(),
        }  # fmt: skip

    def restore(self, state: dict[str, Any]) -> None:
        """Goes on from what another one's `state` told that was made for the same building with the same settings, bit
        by bit as that one would have. Raises KeyError, TypeError or ValueError where it was unlike."""
        clouds = self._session.restore(state["session"], self.clouds)
        self._map = self._session.begin(clouds, self._stopwatch)
        self._map.restore(state["map"])
        self._kidnap_watch.restore(state["kidnap_watch"])
        self._newest_ns, self._held_back = state["newest_ns"], state["held_back"]
        self._stopwatch.seconds = state["seconds"]
