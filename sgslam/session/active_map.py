"""The map that a run is building: its scans, keyframes, floors and factor graph, and its anchoring to the plan."""

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from data.common.bars import steps
from data.control import ControlPoint
from sgslam.anchoring import BuildingAnchoring
from sgslam.backend import Backend
from sgslam.config import Config
from sgslam.geometry.frames import inverse, level_at, level_map, raised, squared_up
from sgslam.loops import LoopCloser
from sgslam.mapping import Anchors, Floors, FloorTransition, KeyframeClouds, KeyframeNode, KeyframeRule, Scene
from sgslam.mapping.wall_points import faces_of, wall_points
from sgslam.perception import keyframe_scan
from sgslam.registration.motion import few_points, motion_from_stamp
from sgslam.session.control_sights import control_residuals, control_sights
from sgslam.session.scan_points import ScanPoints
from sgslam.session.scan_poses import ScanPose, StepUncertainty
from sgslam.session.stopwatch import Stopwatch
from sgslam.surfels import SurfelMap
from sgslam.types import MapCheck, TrackedScan

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
_FOLLOW = 0.1  # share of its change by which the sensor's usual height above the floor follows it at each keyframe


class ActiveMap:
    """The map under construction.

    `begins` are the indices in `scans` at which its runs begin: the first one's, and those of merged runs.
    `first_anchor_ns` is the stamp of the keyframe since which the map is placed in the plan without interruption, None
    while it is not placed.
    """

    def __init__(
        self, config: Config, anchoring: BuildingAnchoring | None, clouds: KeyframeClouds, stopwatch: Stopwatch
    ) -> None:
        self._config = config
        self.anchoring, self.clouds, self.stopwatch = anchoring, clouds, stopwatch
        self.points = ScanPoints(config.tracking, clouds)
        self.floors = Floors(config)
        self.transition = FloorTransition(config.floors, config.surfaces.guessed_height)
        self._surfels = SurfelMap()  # of the scans since the last keyframe, in `odom`
        self._keyframe_rule = KeyframeRule(config.keyframes)
        self.backend = Backend(config)
        self.loops = LoopCloser(config.loops, self.backend.closures)
        self.scans: list[ScanPose] = []
        self.begins = [0]
        self.first_anchor_ns: int | None = None
        self._steps = StepUncertainty(config.odometry)
        self._is_external = False  # the newest scan's pose is an external odometry's

    @property
    def plan_is_prior(self) -> bool:
        """Whether the plan is a prior map, not the building's."""
        return self.anchoring is not None and self.anchoring.partial

    @property
    def placed(self) -> bool:
        """Whether the map is placed in its plan now."""
        return self.backend.T_map_local is not None

    @property
    def T_bim_map(self) -> Floats | None:  # noqa: N802
        """(4, 4) the map in the BIM frame; None while it is not anchored to a building."""
        return None if self.plan_is_prior else self.T_plan_map

    @property
    def T_plan_map(self) -> Floats | None:  # noqa: N802
        """(4, 4) the map in the frame of its plan, which may be a prior map; None while it is not placed."""
        if self.anchoring is None or self.backend.T_map_local is None:
            return None
        return self.anchoring.bim_from_map(self.backend.T_map_local)

    @property
    def T_map_odom(self) -> Floats:  # noqa: N802
        """(4, 4) the frame `odom` in the map: what the graph knows better acts here, and `odom` never jumps."""
        if not self.backend.keyframes or not self.scans:
            return np.eye(4)
        newest = self.backend.keyframes[-1]
        return squared_up(newest.T_map_sensor @ inverse(self.scans[newest.scan].T_odom_sensor))

    def add_scan(self, scan: TrackedScan) -> bool:
        """Adds a tracked scan; returns whether a keyframe is due."""
        keyframes = self.backend.keyframes
        if not self.scans:
            self.floors.current.walls.T_level_map = level_map(None, self.transition.height)
        T_map_sensor = self.T_map_odom @ scan.T_odom_sensor
        since = np.eye(4) if not keyframes else inverse(keyframes[-1].T_map_sensor) @ T_map_sensor
        self.scans.append(
            ScanPose(
                scan.raw.stamp_ns,
                scan.T_odom_sensor,
                T_map_sensor,
                max(len(keyframes) - 1, 0),
                since,
                health=scan.health,
                covariance=scan.covariance,
                motion=motion_from_stamp(scan.registration),
            )
        )
        self._is_external = scan.raw.T_odom_sensor is not None
        self.points.add(scan)
        if scan.raw.step_covariance is not None and len(self.scans) > 1:
            R_sensor_before = scan.T_odom_sensor[:3, :3].T @ self.scans[-2].T_odom_sensor[:3, :3]
            self._steps.add(scan.raw.step_covariance, R_sensor_before)
        if scan.health == "lost" and keyframes:
            return False
        with self.stopwatch("surfaces"):
            thinned = few_points(scan.registration, scan.raw.points, self._config.tracking)
            self._surfels.add_scan(thinned, scan.T_odom_sensor)
        landed = self._follow_floor(self.scans[-1])
        return self._keyframe_rule.offer(T_map_sensor) or landed

    def _follow_floor(self, scan: ScanPose) -> bool:
        """Whether the sensor arrives on level ground after a climb."""
        T_level_map = self.floors.current.walls.T_level_map
        T_level_sensor = T_level_map @ scan.T_map_sensor
        arrival = self.transition.follow(T_level_sensor, T_level_map, self.floors)
        if arrival is None:
            return False
        if arrival.floor is None:
            self.floors.begin().walls.T_level_map = raised(T_level_map, -arrival.height)
            _log.info("a new floor begins, %+.2f m from the one that was left", arrival.height)
        else:
            self.floors.current = arrival.floor
            arrival.floor.levels.drift = arrival.drift
        return True

    def add_keyframe(self, points: Floats | None) -> None:
        """Makes the newest scan a keyframe, with the walls and floor extracted from its points (N, 3)."""
        scan = self.scans[-1]
        before = self.backend.keyframes[-1].T_track_sensor if self.backend.keyframes else np.eye(4)
        tracked = before @ scan.T_keyframe_sensor  # unlike the map, this does not jump when the graph is optimised
        storey = None if self.transition.active else self.floors.current.number
        keyframe = KeyframeNode(len(self.scans) - 1, scan.stamp_ns, tracked, scan.T_map_sensor, storey=storey)
        keyframe.step_covariance, keyframe.weak_step = self._steps.leave(scan.covariance, self._is_external)
        if points is not None:
            with self.stopwatch("surfaces"):
                if storey is not None:
                    self._observe(keyframe, points)
                self._surfels.clear()  # those of stairs are of no floor
                self.clouds.add(len(self.backend.keyframes), points)
        self.backend.add_keyframe(keyframe)
        scan.keyframe = len(self.backend.keyframes) - 1
        scan.T_previous_sensor, scan.T_keyframe_sensor = scan.T_keyframe_sensor, np.eye(4)

    def _observe(self, keyframe: KeyframeNode, points: Floats) -> None:
        """Extracts the surfaces that are seen from a keyframe and adds them to it and to the floor's map."""
        floor = self.floors.current
        T_level_map = raised(floor.walls.T_level_map, -self.transition.ground)  # z = 0 at the ground under the sensor
        T_level_sensor, T_odom_sensor = T_level_map @ keyframe.T_map_sensor, self.scans[-1].T_odom_sensor
        up, height = T_level_sensor[2, :3], float(T_level_sensor[2, 3])
        seen = keyframe_scan(points, self._surfels.surfels(), T_odom_sensor, up, height, self._config)
        keyframe.outline, keyframe.lintels = seen.contour, seen.lintels
        keyframe.up, keyframe.sigma_up = seen.up, seen.sigma_up
        number = len(self.backend.keyframes)
        floor.levels.add(number, keyframe.T_map_sensor, seen.levels)
        floor.walls.add(number, keyframe.T_map_sensor, seen.walls)
        self._follow_height(keyframe.T_map_sensor, lambda: floor.find_floor(self.transition.height))
        height = float((floor.walls.T_level_map @ keyframe.T_map_sensor)[2, 3])
        if floor.plane_in_map is not None:
            self.transition.height += _FOLLOW * (height - self.transition.ground - self.transition.height)

    def _follow_height(self, T_map_sensor: Floats, level: Callable[[], None]) -> None:
        """Levels the map again. Where the floor proves to lie lower, the sensor at a pose (4, 4) is as much higher."""
        walls = self.floors.current.walls
        before = float((walls.T_level_map @ T_map_sensor)[2, 3])
        level()
        self.transition.height += float((walls.T_level_map @ T_map_sensor)[2, 3]) - before

    @property
    def has_grown(self) -> bool:
        """Whether the map has grown enough since the last `update`."""
        return self.backend.due or self._scene_due(if_placed=False)

    def update(self, last: bool = False) -> None:
        """Optimises, closes loops, segments rooms, matches and anchors; all floors are segmented if `last`."""
        anchors = self._anchors(last)
        self._estimate(anchors, last)
        self._close_loops(anchors)
        if last:
            self._cut_scenes()
        elif self._scene_due():
            with self.stopwatch("rooms"):
                self.floors.current.cut(self.backend.keyframes, self._config)
            if not self.placed and (anchors := self._anchors(last)) is not None:
                self._estimate(anchors, last)

    def complete(self) -> None:
        """Matches and optimises for the last time."""
        if self.backend.keyframes[-1].scan != len(self.scans) - 1:
            self.add_keyframe(None)
            if self.has_grown:
                self.update()
        self.update()
        self._cut_scenes()
        self.update(last=True)
        if self.anchoring is None:
            return
        with self.stopwatch("matching"):  # the reported match is the one on the final map
            confirmed = self.anchoring.confirm(self.floors, self.backend.T_map_local)
        if not confirmed or (self.anchoring.committed is not None and not self.placed):
            self.update(last=True)

    def take_tracked(self, poses: Floats, of_points: Floats) -> None:
        """Replaces the tracked motion of all scans by that between their `poses` (N, 4, 4) in the map, which a second
        pass found. The graph's steps follow it, by the poses `of_points` (N, 4, 4) where the scans' undistorted points
        lie right: these were placed by the motion found first."""
        keyframes = self.backend.keyframes
        for keyframe in keyframes:
            keyframe.T_track_sensor = of_points[keyframe.scan]
            keyframe.smoothed = True
        for i, scan in enumerate(self.scans):
            own = keyframes[scan.keyframe]
            scan.T_keyframe_sensor = inverse(of_points[own.scan]) @ poses[i]
            if own.scan == i and scan.keyframe:
                scan.T_previous_sensor = inverse(of_points[keyframes[scan.keyframe - 1].scan]) @ of_points[i]
        first, began = of_points[keyframes[0].scan], level_at(keyframes[0].T_map_sensor)
        self.backend.take_steps(began @ inverse(level_at(first)) @ first)  # only its tilt is new

    def refine(self, control: Sequence[ControlPoint] = ()) -> MapCheck:
        """Refines a map that is anchored to a building by all points that its keyframes saw on planned walls, and by
        control points; returns how well it then agrees with walls that are left out, and with these points."""
        if not self._config.anchors.points or self.T_bim_map is None or self.anchoring is None:
            return MapCheck()
        with self.stopwatch("adjustment"):
            T_plan_sensor = self.T_bim_map @ self.backend.poses
            faces = faces_of(self.anchoring.a_graph)
            clouds = ((T, self.clouds[k]) for k, T in enumerate(steps(T_plan_sensor, "points on walls")))
            seen = wall_points(faces, clouds)
            in_local, origin = replace(seen, place=seen.place - self.anchoring.origin[:2]), self.anchoring.origin
            sights = control_sights(control, self.scans, self._config.odometry.sigma_translation)
            sights_in_local = [replace(own, place=own.place - origin) for own in sights]
            held_out = self.backend.refine(faces, in_local, sights_in_local)
        self.floors.refresh(*self.backend.estimates, self.transition.height, last=True)
        self._cut_scenes()
        return MapCheck(held_out, control_residuals(sights, self.T_bim_map @ self.backend.poses))

    def _anchors(self, last: bool) -> Anchors | None:
        """The anchors to the plan; None while the map is not placed."""
        if self.anchoring is None:
            return None
        with self.stopwatch("matching"):
            return self.anchoring.update(self.floors, self.backend.T_map_local, last)

    def _close_loops(self, anchors: Anchors | None) -> None:
        """Closes loops, withdraws contradicted closures and optimises until nothing changes. An anchored map needs no
        loop closure unless the odometry may have slipped."""
        for _ in range(3):  # at most
            keyframes, floor = self.backend.keyframes, self.floors.current
            if self.placed and not any(keyframe.weak_step for keyframe in keyframes):
                return
            with self.stopwatch("loops"):
                opened = self.loops.contradicted(keyframes)
                closed = self.loops.look(keyframes, floor.number, floor.walls.T_level_map, self.clouds)
                self.loops.part_walls(closed, floor.walls, keyframes)
            if not closed and not opened:
                return
            self._estimate(anchors, last=True)

    def _estimate(self, anchors: Anchors | None, last: bool) -> None:
        """Optimises the graph and merges walls that turn out to be the same."""
        with self.stopwatch("optimisation"):
            self.backend.optimise(
                self.floors.seen, self.floors.levels, self.floors.rooms, anchors, steps=20 if last else 6
            )
        newest = self.backend.keyframes[-1]
        self.scans[-1].T_map_sensor = newest.T_map_sensor
        if not self.placed:
            self.first_anchor_ns = None
        elif self.first_anchor_ns is None:
            self.first_anchor_ns = newest.stamp_ns
        with self.stopwatch("surfaces"):
            refresh = partial(self.floors.refresh, *self.backend.estimates, self.transition.height, last)
            self._follow_height(newest.T_map_sensor, refresh)

    def _scene_due(self, if_placed: bool = True) -> bool:
        """Whether there is a plan and the current floor has grown enough since its rooms were last segmented."""
        if self.anchoring is None or (self.placed and not if_placed):
            return False
        return self.floors.due(self.backend.keyframes, not self.placed)

    def _cut_scenes(self) -> None:
        with self.stopwatch("rooms"):
            for floor in self.floors.maps:
                floor.cut(self.backend.keyframes, self._config)

    def scenes_now(self) -> list[Scene]:
        """The scenes of all floors by the present estimates; the floors' own scenes do not change."""
        known = self.floors.maps if self.backend.keyframes else []
        return [floor.scene_now(self.backend.keyframes, self._config) for floor in known]
