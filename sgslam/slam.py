"""The loop: scans go in, the S-graph grows, is matched, is anchored; a trajectory in building coordinates comes out."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data import SceneGraph, UserError
from data.plans.bim import Bim
from sgslam.anchoring.anchor_log import AnchorRecord
from sgslam.anchoring.building_anchoring import BuildingAnchoring
from sgslam.anchoring.matcher_protocol import AnyMatcher, default_matcher
from sgslam.anchoring.storey_hypotheses import floor_named
from sgslam.backend.backend import Backend
from sgslam.config import Config
from sgslam.geometry.frames import inverse, level_map, transform_planes
from sgslam.loops.closure import LoopCloser
from sgslam.mapping.floors import Floors
from sgslam.mapping.graph_nodes import Anchors
from sgslam.mapping.keyframe_clouds import KeyframeClouds
from sgslam.mapping.keyframes import KeyframeNode, KeyframeRule
from sgslam.odometry import Odometry, make_odometry
from sgslam.perception.deskew import checked_times
from sgslam.perception.scan_checks import checked_scan
from sgslam.session.prior_map import KnownMap, plan_of
from sgslam.session.result import Result, Returned, ScanPose, Update, finished
from sgslam.session.snapshot import Snapshot, taken
from sgslam.tracking.front_end import FrontEnd, level_to_sensor
from sgslam.tracking.kidnap import Doubted, LeapWatch, all_fit
from sgslam.tracking.scan_tracker import Locator

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
_UNLIKE = 3  # scans, one after the other, that do not fit to those before: the sensor was carried elsewhere
_LOOP_ROUNDS = 3  # of closing loops and optimising, at most


class SceneGraphSlam:
    """SLAM with an S-graph, anchored to a building's A-graph where one is given.

    `bim` is an A-graph in the BIM frame (or what `load_bim` gives), `matcher` any object with `.match(s, a)`,
    `odometry` any `Odometry` (KISS-ICP by default), `clouds` where the keyframes' points are kept (a nameless file by
    default). `known` is the map of earlier runs, in which this one finds itself, wherever it starts, and to which it is
    joined at the end: all is in that map's frame then. Scans are added in the order of their stamps. `storey` is the
    name or the id of the A-graph's floor on which the run begins; raises UserError for one that there is not.
    """

    def __init__(
        self, bim: SceneGraph | Bim | None = None, matcher: AnyMatcher | None = None, config: Config | None = None,
        odometry: Odometry | None = None, clouds: KeyframeClouds | None = None, known: KnownMap | None = None,
        storey: str | None = None,
    ) -> None:  # fmt: skip
        self._config = config or Config()
        self.clouds = KeyframeClouds(None, self._config.clouds.keyframe_voxel) if clouds is None else clouds
        a_graph = bim.graph if isinstance(bim, Bim) else bim
        self._bim = a_graph
        self._odometry = odometry or make_odometry(self._config.odometry)
        self._is_own_odometry = odometry is None
        self._known, self._matcher = known, matcher
        self._start = None if storey is None or a_graph is None else floor_named(a_graph, storey).id
        self._newest_ns: int | None = None
        self._doubted: list[Doubted] = []  # the newest scans, where these cannot have been taken near the one before
        self._leaps = 0  # times that the sensor was carried elsewhere
        self._lost: list[KnownMap] = []  # parts of the run of which nobody knows where they are
        self._begin()
        stages = ("odometry", "surfaces", "rooms", "loops", "matching", "optimisation")
        self.seconds: dict[str, float] = dict.fromkeys(stages, 0.0)

    def _begin(self) -> None:
        """A map of its own, which is to be found in the known one or in the building."""
        config = self._config
        self._front_end, self._rule, self._floors = FrontEnd(config), KeyframeRule(config.keyframes), Floors(config)
        self._locator = Locator(config, self._odometry, self._front_end, self._floors)
        self._backend, self._loops, self._watch = Backend(config), LoopCloser(config.loops), LeapWatch()
        plan, self._plan_is_known = (self._bim, False) if self._known is None else plan_of(self._known, self._bim)
        self._anchoring = self._anchored_in(plan)
        self._begins = [0]  # the places in the scans at which a run begins
        self._scans: list[ScanPose] = []
        self._first_anchor_ns: int | None = None

    def add_scan(
        self, stamp_ns: int, points: NDArray[np.floating[Any]], point_times: NDArray[np.floating[Any]] | None = None,
        T_odom_sensor: Floats | None = None,
    ) -> Update:  # fmt: skip
        """Adds one scan and returns where it was taken, as far as is known now.

        `stamp_ns` is in nanoseconds and must increase from scan to scan. `points` are (N, 3) metres in the sensor's
        frame, N at least 1, float32 or float64. `point_times` (N,) are seconds after the stamp: with them the scan is
        deskewed. `T_odom_sensor` (4, 4) is the sensor's pose in the frame of an odometry of yours; it replaces our own
        odometry for this scan.

        Raises UserError for stamps that do not increase, for points and times that are not finite or of another shape,
        and for a `T_odom_sensor` that is no rigid motion; the run goes on without that scan.

        Where scan after scan cannot have been taken near those before, the sensor was carried elsewhere: a new map is
        begun, in which the run goes on until it is found in the old one, or in the building.
        """
        checked = checked_scan(stamp_ns, points, T_odom_sensor, self._newest_ns)
        self._newest_ns = int(stamp_ns)
        return self._take(Doubted(int(stamp_ns), checked, point_times, T_odom_sensor))

    def _take(self, scan: Doubted, trusted: bool = False) -> Update:
        stamp_ns, points, T_odom_sensor, offset_ns = scan.stamp_ns, scan.points, scan.T_odom_sensor, 0
        with self._clock("odometry"):
            if scan.point_times is not None:
                seconds = checked_times(scan.point_times, len(points), stamp_ns)
                points, offset_ns = self._locator.deskewed(stamp_ns, points, seconds, T_odom_sensor)
            columns = self._front_end.columns(points, whole=self._locator.climbing)
            if not (trusted or self._locator.climbing or self._watch.fits(columns)):
                return self._doubt(scan)
        if not trusted:
            self._settle()
        with self._clock("odometry"):
            self._watch.keep(columns)
            last = self._scans[-1].T_map_sensor if self._scans else None
            located = self._locator.locate(stamp_ns + offset_ns, columns, last, T_odom_sensor)
            T_odom_sensor, T_map_sensor = located.T_odom_sensor, located.T_map_sensor
        since = np.eye(4) if not self._scans else inverse(self._backend.keyframes[-1].T_map_sensor) @ T_map_sensor
        keyframe = len(self._backend.keyframes) - 1
        self._scans.append(ScanPose(stamp_ns, T_odom_sensor, T_map_sensor, keyframe, since, offset_ns=offset_ns))
        if located.T_map_landed is not None:  # the step stays as measured: the drift is of all of the climb
            self._scans[-1].T_map_sensor = located.T_map_landed
        if self._rule.wants(T_map_sensor) or located.T_map_landed is not None:
            self._add_keyframe(points)
        live = self._locator.live(self._scans[-1].T_map_sensor, offset_ns)
        return Update(stamp_ns, live, len(self._backend.keyframes), self.anchored)

    def _doubt(self, scan: Doubted) -> Update:
        """Waits with scans that do not fit to those before, until it is clear that the sensor was carried elsewhere."""
        self._doubted.append(scan)
        if len(self._doubted) < _UNLIKE:
            return Update(scan.stamp_ns, self._scans[-1].T_map_sensor, len(self._backend.keyframes), self.anchored)
        doubted, self._doubted = self._doubted, []
        if all_fit([self._front_end.columns(one.points) for one in doubted]):
            _log.warning("at %d ns the sensor was carried elsewhere: a new map begins", doubted[0].stamp_ns)
            self._part()
        return [self._take(one, trusted=True) for one in doubted][-1]

    def _settle(self) -> None:
        """Takes the scans that were waited with, which were only odd."""
        while self._doubted:
            self._take(self._doubted.pop(0), trusted=True)

    def _part(self) -> None:
        """What was mapped up to now is known from now on, and a new map begins."""
        self._complete()
        T_known_map, own = self.T_known_map, self._own()
        if self._known is None:
            self._known = own
        elif T_known_map is not None:
            self._known.join(own, T_known_map, self._config, same_run=self._leaps > len(self._lost))
        else:
            self._lost.append(own)
        self._leaps += 1
        self.clouds = KeyframeClouds(None, self._config.clouds.keyframe_voxel)
        if self._is_own_odometry:  # another one finds its track again by itself
            self._odometry = make_odometry(self._config.odometry)
        self._begin()

    def _own(self) -> KnownMap:
        height, T_bim_map = self._front_end.height, self.T_bim_map
        return KnownMap(self._backend, self._floors, self._scans, self._begins, height, T_bim_map, self.clouds)

    @property
    def anchored(self) -> bool:
        """Whether the S-graph is anchored to the BIM."""
        return not self._plan_is_known and self._backend.T_map_bim is not None

    @property
    def T_known_map(self) -> Floats | None:  # noqa: N802
        """(4, 4) the map in the frame of the known one, as it is known now; None where it was not found in it yet."""
        T_map_bim, known = self._backend.T_map_bim, self._known
        if known is None or self._anchoring is None or T_map_bim is None:
            return None
        T_known_plan = inverse(known.T_plan_map if known.T_bim_map is None or self._plan_is_known else known.T_bim_map)
        return np.asarray(T_known_plan @ self._anchoring.bim_from_map(T_map_bim))

    @property
    def T_bim_map(self) -> Floats | None:  # noqa: N802
        """(4, 4) the map in the BIM frame, as it is known now; None while it is not anchored."""
        T_map_bim = self._backend.T_map_bim
        if self._anchoring is None or T_map_bim is None or self._plan_is_known:
            return None
        return self._anchoring.bim_from_map(T_map_bim)

    @property
    def anchors(self) -> tuple[AnchorRecord, ...]:
        """The record of all anchors so far, those withdrawn too."""
        return () if self._anchoring is None else self._anchoring.records

    @property
    def keyframes(self) -> int:
        """How many there are so far, up to the first leap."""
        return len((self._known.backend if self._leaps and self._known is not None else self._backend).keyframes)

    def state(self) -> dict[str, Any]:
        """All that it knows but the keyframes' points, which `clouds` keep, as a tree (see `state_tree`). It is not a
        copy: write it before the next scan is added."""
        own = {
            "newest_ns": self._newest_ns, "doubted": self._doubted, "leaps": self._leaps,
            "lost": [lost.state() for lost in self._lost],
            "known": self._known.state() if self._known is not None and self._leaps else None,
            "scans": self._scans, "begins": self._begins, "first_anchor_ns": self._first_anchor_ns,
            "seconds": self.seconds, "T_bim_map": self.T_bim_map,
        }  # fmt: skip
        return own | {name: part.state() for name, part in self._parts.items()}

    def restore(self, state: dict[str, Any]) -> None:
        """Goes on from what another one's `state` told that was made for the same building with the same settings, bit
        by bit as that one would have. Raises KeyError, TypeError or ValueError where it was unlike."""
        if state["known"] is not None:  # the points of what came after the first leap are not kept
            self._known, own = KnownMap.restored(state["known"], self._config, self.clouds), self.clouds
            self.clouds = KeyframeClouds(None, own.voxel)
        self._lost = [
            KnownMap.restored(lost, self._config, KeyframeClouds(None, self.clouds.voxel)) for lost in state["lost"]
        ]  # fmt: skip
        self._begin()
        for name, part in self._parts.items():
            part.restore(state[name])
        self._newest_ns, self._doubted, self._leaps = state["newest_ns"], state["doubted"], state["leaps"]
        self._scans, self._first_anchor_ns, self.seconds = state["scans"], state["first_anchor_ns"], state["seconds"]
        self._begins = state["begins"]

    @property
    def _parts(self) -> dict[str, Any]:
        parts = {
            "front_end": self._front_end, "rule": self._rule, "floors": self._floors, "loops": self._loops,
            "odometry": self._odometry, "locator": self._locator, "slack": self._locator.slack,
            "backend": self._backend, "watch": self._watch,
        }  # fmt: skip
        return parts if self._anchoring is None else {**parts, "anchoring": self._anchoring}

    @property
    def loops(self) -> LoopCloser:
        """Which loops were closed, and which of them were opened again."""
        return self._loops

    def s_graph(self) -> SceneGraph:
        """The S-graph as it is now, in the map frame: rooms, wall surfaces and doors are cut anew for it, which takes
        some tens of milliseconds and changes nothing in the run. Raises UserError before the first scan."""
        if not self._scans:
            raise UserError("no scan was added: there is no graph yet")
        scenes = [self._floors.cut(floor, self._backend) for floor in self._floors.maps]
        return self._floors.graph(self._backend.keyframes, scenes)

    def snapshot(self) -> Snapshot:
        """What is known now, for those who look on; raises ValueError before the first scan."""
        return taken(self._backend, self._floors, self._anchoring, self.clouds)

    def finish(self) -> Result:
        """Matches and optimises a last time, and returns the trajectories, the S-graph, the matches and the deviations.

        Raises UserError where no scan was added.
        """
        if not self._scans:
            raise UserError("no scan was added: nothing to finish")
        self._settle()
        self._complete()
        returned = None if self._known is None else self._return_to(self._known)
        return finished(
            self._scans, self._backend, self._floors, self._bim, None if self._plan_is_known else self._anchoring,
            self._first_anchor_ns, self.seconds, self._config, self.clouds, self._begins, returned,
            [(lost.scans, lost.backend.poses) for lost in self._lost],
        )  # fmt: skip

    def _complete(self) -> None:
        """Matches and optimises a last time."""
        if self._backend.keyframes[-1].scan != len(self._scans) - 1:
            self._add_keyframe(None)
        self._optimise(last=False)
        self._cut_scenes()
        self._optimise(last=True)
        if self._anchoring is not None:
            with self._clock("matching"):  # the answer that is given is the one on the final map
                confirmed = self._anchoring.confirm(self._floors, self._backend.T_map_bim)
            if not confirmed or (self._anchoring.committed is not None and self._backend.T_map_bim is None):
                self._optimise(last=True)

    def _return_to(self, known: KnownMap) -> Returned:
        """Joins the run to the known map, if it was found in it; the BIM then holds both."""
        T_known_map, found_ns = self.T_known_map, self._first_anchor_ns
        reason = "" if self._anchoring is None else self._anchoring.reason
        began_ns, of_this_run = self._scans[0].stamp_ns, self._leaps > len(self._lost)
        if T_known_map is not None:
            known.join(self._own(), T_known_map, self._config, same_run=of_this_run)
        elif of_this_run:  # what was before the leap is what is known, and nothing harms it
            self._lost.append(self._own())
        if T_known_map is not None or of_this_run:
            matcher = self._matcher or default_matcher(self._config)
            self._lost = known.take_back(self._lost, self._bim, matcher, self._config)
            self._backend, self._floors, self.clouds = known.backend, known.floors, known.clouds
            self._scans, self._begins = known.scans, known.begins
            self._loops = LoopCloser(self._config.loops)
            self._loops.go_on_from(self._backend.closures, len(self._backend.keyframes))
        elif not self._plan_is_known or self._bim is None:
            return Returned(False, None, reason)
        self._plan_is_known, self._anchoring = False, self._anchored_in(self._bim)
        self._complete()
        if T_known_map is None or found_ns is None:
            return Returned(False, None, reason)
        return Returned(True, (found_ns - began_ns) / 1e9, reason)

    def _anchored_in(self, plan: SceneGraph | None) -> BuildingAnchoring | None:
        if plan is None:
            return None
        start = self._start if self._known is None else None  # a known map has floors of its own
        matcher = self._matcher or default_matcher(self._config)
        return BuildingAnchoring(plan, matcher, self._config, start, partial=self._plan_is_known)

    def _add_keyframe(self, points: Floats | None) -> None:
        """Makes the newest scan a keyframe, with what can be seen in its points."""
        scan = self._scans[-1]
        before = self._backend.keyframes[-1].T_odom_sensor if self._backend.keyframes else np.eye(4)
        tracked = before @ scan.T_keyframe_sensor  # the map jumps when it is optimised, this does not
        storey = None if self._locator.climbing else self._floors.current.number
        keyframe = KeyframeNode(len(self._scans) - 1, scan.stamp_ns, tracked, scan.T_map_sensor, storey=storey)
        keyframe.slack = self._locator.leave_keyframe()
        if points is not None:
            with self._clock("surfaces"):
                if storey is not None:
                    self._see(keyframe, points)
                self.clouds.add(len(self._backend.keyframes), points)
        self._backend.add_keyframe(keyframe)
        scan.keyframe = len(self._backend.keyframes) - 1
        scan.T_previous_sensor, scan.T_keyframe_sensor = scan.T_keyframe_sensor, np.eye(4)
        if self._backend.due or self._scene_due(if_placed=False):
            self._optimise(last=False)

    def _see(self, keyframe: KeyframeNode, points: Floats) -> None:
        """Takes what a keyframe's scan shows of its floor into the keyframe and the floor's map."""
        floor, known = self._floors.current, self._backend.floors_in_map
        T_level_map = self._locator.T_ground_map
        height = float((T_level_map @ keyframe.T_map_sensor)[2, 3]) if floor.number in known else None
        seen = self._front_end.look(points, level_to_sensor(keyframe.T_map_sensor, T_level_map[2, :3]), height)
        keyframe.floor, keyframe.outline, keyframe.lintels = seen.floor, seen.contour, seen.lintels
        if self._locator.ground:
            keyframe.floor = None
        elif seen.floor is not None and floor.number not in known:
            floor_in_map = transform_planes(keyframe.T_map_sensor, seen.floor.plane)
            floor.walls.T_level_map = level_map(floor_in_map, self._front_end.height)
        floor.walls.add(len(self._backend.keyframes), keyframe.T_map_sensor, seen.walls)

    def _optimise(self, last: bool) -> None:
        """Optimises, joins walls, cuts rooms, matches and anchors."""
        self._estimate(anchors := self._anchors(last), last)
        for _ in range(_LOOP_ROUNDS):
            if (self._backend.T_map_bim is not None and not self._backend.loose) or not self._close_loops():
                break
            self._estimate(anchors, last=True)
        if last:
            self._cut_scenes()
        elif self._scene_due():
            with self._clock("rooms"):
                self._floors.current.scene = self._floors.cut(self._floors.current, self._backend)
            if self._backend.T_map_bim is None and (anchors := self._anchors(last)) is not None:
                self._estimate(anchors, last)

    def _anchors(self, last: bool) -> Anchors | None:
        """What the map hangs on in the plan, where it has a place in it."""
        if self._anchoring is None:
            return None
        with self._clock("matching"):
            return self._anchoring.update(self._floors, self._backend.T_map_bim, last)

    def _close_loops(self) -> bool:
        """Whether loops were closed or opened again, so that the map is to be optimised anew."""
        with self._clock("loops"):
            opened = self._loops.contradicted(self._backend.keyframes)
            floor = self._floors.current
            closed = self._loops.look(self._backend.keyframes, floor.number, floor.walls, self.clouds, floor.scene)
            self._backend.closures = list(self._loops.closures)
            self._loops.part_walls(closed, floor.walls, self._backend.keyframes)
        return bool(closed or opened)

    def _estimate(self, anchors: Anchors | None, last: bool) -> None:
        """Moves the map to the optimum and joins the walls that turn out to be one."""
        with self._clock("optimisation"):
            self._backend.optimise(self._floors.seen, self._floors.rooms, anchors, steps=20 if last else 6)
        newest = self._backend.keyframes[-1]
        self._scans[-1].T_map_sensor = newest.T_map_sensor
        if self._backend.T_map_bim is None:
            self._first_anchor_ns = None
        elif self._first_anchor_ns is None:
            self._first_anchor_ns = newest.stamp_ns
        with self._clock("surfaces"):
            self._floors.refresh(self._backend, self._front_end.height, last)

    def _scene_due(self, if_placed: bool = True) -> bool:
        """Whether there is a plan, and the floor that the robot is on has grown enough since it was last cut."""
        unplaced, anchoring = self._backend.T_map_bim is None, self._anchoring
        if anchoring is None or not (unplaced or if_placed):
            return False
        return self._floors.due(self._backend.keyframes, self._config.backend, unplaced, anchoring.all_but_sure)

    def _cut_scenes(self) -> None:
        with self._clock("rooms"):
            for floor in self._floors.maps:
                floor.scene = self._floors.cut(floor, self._backend)

    @contextmanager
    def _clock(self, stage: str) -> Iterator[None]:
        began = perf_counter()
        yield
        self.seconds[stage] += perf_counter() - began
