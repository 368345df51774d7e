"""The factor graph of a run: keyframes, walls, floor, rooms, the BIM frame. Batch optimisation, warm started.

The graph is built from the observations each time, so that walls can be joined and anchors withdrawn without
ever editing a graph; factors whose variables did not change are reused.
"""

import logging
from dataclasses import dataclass, field

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, F, O, P, R, W, X
from numpy.typing import NDArray

import factors
from sgslam.config import Config
from sgslam.frames import inverse, transform_planes
from sgslam.keyframes import KeyframeNode
from sgslam.uncertainty import Uncertainty
from sgslam.wall_map import SeenWall

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
_BIM, _FLOOR, _IDENTITY = B(0), F(0), O(0)


@dataclass(frozen=True)
class RoomNode:
    """A room of the S-graph as a pose with the walls that bound it, planes (4,) in the room's frame."""

    id: int
    T_map_room: Floats
    walls: dict[int, Floats]


@dataclass(frozen=True)
class PlannedWall:
    """A planned plane (4,) and the place (3,) near it where the wall was seen, both in the BIM frame."""

    plane: Floats
    place: Floats


@dataclass(frozen=True)
class Anchors:
    """What ties the S-graph to the BIM: walls and rooms by their numbers, the BIM frame near the building."""

    T_map_bim: Floats
    planes: dict[int, list[PlannedWall]]
    rooms: dict[int, Floats]  # room -> T_bim_room (4, 4)
    elevation: float | None  # of the storey's floor
    loose: dict[int, list[PlannedWall]] = field(default_factory=dict)  # as `planes`: walls that stand otherwise
    bent: dict[int, list[PlannedWall]] = field(default_factory=dict)  # as `planes`: where the map is to be bent back


class Backend:
    """Estimates of keyframes, walls, floor, rooms and T_map_bim."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self.keyframes: list[KeyframeNode] = []
        self.planes_in_map: dict[int, Floats] = {}
        self.floor_in_map: Floats | None = None
        self.T_map_bim: Floats | None = None
        self._odometry: list[gtsam.NonlinearFactor] = []
        self._observations: dict[tuple[int, int, int], gtsam.NonlinearFactor] = {}
        self._optimised_at = 0
        self._optimum: tuple[gtsam.NonlinearFactorGraph, gtsam.Values, dict[int, int]] | None = None

    def add_keyframe(self, keyframe: KeyframeNode) -> None:
        """Adds a keyframe, tied to the one before it by the odometry between them."""
        if self.keyframes:
            last = self.keyframes[-1]
            step = inverse(last.T_odom_sensor) @ keyframe.T_odom_sensor
            settings = self._config.odometry
            noise = factors.noise_of_pose(settings.sigma_rotation, settings.sigma_translation)
            i = len(self.keyframes)
            self._odometry.append(gtsam.BetweenFactorPose3(X(i - 1), X(i), gtsam.Pose3(step), noise))
        self.keyframes.append(keyframe)

    @property
    def poses(self) -> Floats:
        """(K, 4, 4) T_map_sensor of all keyframes."""
        return np.stack([k.T_map_sensor for k in self.keyframes])

    @property
    def due(self) -> bool:
        """Whether the graph has grown enough since the last optimisation; a share of it, so that the cost of
        all optimisations stays in proportion to the length of the run."""
        settings = self._config.backend
        grown = len(self.keyframes) - self._optimised_at
        return grown >= max(settings.every_keyframes, settings.growth * len(self.keyframes))

    def optimise(self, seen: list[SeenWall], rooms: list[RoomNode], anchors: Anchors | None, steps: int = 6) -> None:
        """Builds the graph of all that is known and moves the estimates to its optimum.

        An optimisation that fails, or whose error is not finite, leaves the estimates as they were, with a
        warning.
        """
        graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
        self._add_poses(graph, values)
        anchor_of = self._add_walls(graph, values, seen)
        self._add_floor(graph, values)
        self._add_rooms(graph, values, rooms, anchor_of)
        if anchors is not None:
            self._add_anchors(graph, values, anchors, anchor_of, {room.id for room in rooms})
        parameters = gtsam.LevenbergMarquardtParams()
        parameters.setMaxIterations(steps)
        parameters.setRelativeErrorTol(1e-4)
        self._optimised_at = len(self.keyframes)
        optimizer = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters)
        try:
            result = optimizer.optimize()
        except RuntimeError as error:
            _log.warning("the optimisation failed, the estimates stay: %s", str(error).strip().partition("\n")[0])
            return
        if not np.isfinite(optimizer.error()):
            _log.warning("the optimisation's error is not finite, the estimates stay")
            return
        self._take(result, anchor_of)
        self._optimum = graph, result, anchor_of

    def uncertainty(self) -> Uncertainty | None:
        """What the last optimisation that succeeded says of its own errors; None where there was none, or where it
        leaves something free."""
        if self._optimum is None:
            return None
        try:
            return Uncertainty(*self._optimum)
        except RuntimeError as error:
            _log.warning("there are no covariances: %s", error)
            return None

    def _add_poses(self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> None:
        tight = factors.noise_of_pose(1e-5, 1e-5)
        graph.add(gtsam.PriorFactorPose3(X(0), gtsam.Pose3(), tight))
        graph.add(gtsam.PriorFactorPose3(_IDENTITY, gtsam.Pose3(), tight))
        values.insert(_IDENTITY, gtsam.Pose3())
        for i, keyframe in enumerate(self.keyframes):
            values.insert(X(i), gtsam.Pose3(keyframe.T_map_sensor))
        for factor in self._odometry:
            graph.add(factor)

    def _add_walls(
        self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, seen: list[SeenWall]
    ) -> dict[int, int]:
        """Adds walls seen from two keyframes or more; returns the keyframe that each one is kept by."""
        keyframes_of: dict[int, set[int]] = {}
        for s in seen:
            keyframes_of.setdefault(s.wall, set()).add(s.keyframe)
        anchor_of = {wall: min(k) for wall, k in keyframes_of.items() if len(k) >= 2}
        for number, s in enumerate(seen):
            anchor = anchor_of.get(s.wall)
            if anchor is None:
                continue
            key = (number, s.wall, anchor)
            if key not in self._observations:
                self._observations[key] = self._observation(s, anchor)
            graph.add(self._observations[key])
            if not values.exists(P(s.wall)):
                T_anchor_map = inverse(self.keyframes[anchor].T_map_sensor)
                in_map = self.planes_in_map.get(s.wall)
                local = s.plane if in_map is None else transform_planes(T_anchor_map, in_map)
                values.insert(P(s.wall), gtsam.OrientedPlane3(local))
        return anchor_of

    def _observation(self, seen: SeenWall, anchor: int) -> gtsam.NonlinearFactor:
        settings = self._config.backend
        normal = float(np.hypot(seen.sigma_normal, settings.sigma_normal))
        offset = float(np.hypot(seen.sigma_offset, settings.sigma_offset))
        if seen.keyframe == anchor:
            noise = factors.noise_of_plane(normal, offset, None)
            return factors.observe_own_plane(seen.plane, _IDENTITY, P(seen.wall), noise)
        robust = factors.noise_of_plane(normal, offset, settings.huber)
        return factors.observe_plane(seen.plane, X(seen.keyframe), X(anchor), P(seen.wall), robust)

    def _add_floor(self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> None:
        settings = self._config.backend
        for i, keyframe in enumerate(self.keyframes):
            if keyframe.floor is None:
                continue
            normal = float(np.hypot(keyframe.floor.sigma_normal, settings.sigma_floor_normal))
            offset = float(np.hypot(keyframe.floor.sigma_offset, settings.sigma_floor_offset))
            if i == 0:
                noise = factors.noise_of_plane(normal, offset, None)
                graph.add(factors.observe_own_plane(keyframe.floor.plane, _IDENTITY, _FLOOR, noise))
            else:
                robust = factors.noise_of_plane(normal, offset, settings.huber)
                graph.add(factors.observe_plane(keyframe.floor.plane, X(i), X(0), _FLOOR, robust))
            if not values.exists(_FLOOR):
                in_map = transform_planes(keyframe.T_map_sensor, keyframe.floor.plane)
                values.insert(_FLOOR, gtsam.OrientedPlane3(in_map if self.floor_in_map is None else self.floor_in_map))

    def _add_rooms(
        self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, rooms: list[RoomNode], anchor_of: dict[int, int]
    ) -> None:
        noise = factors.noise_of_plane(0.02, 0.03, self._config.backend.huber)
        loose = factors.noise_of_pose(10.0, 1000.0)  # height, roll and pitch of a room are given by nothing else
        for room in rooms:
            values.insert(R(room.id), gtsam.Pose3(room.T_map_room))
            graph.add(gtsam.PriorFactorPose3(R(room.id), gtsam.Pose3(room.T_map_room), loose))
            for wall, plane in room.walls.items():
                if wall in anchor_of:
                    graph.add(factors.wall_of_room(plane, R(room.id), X(anchor_of[wall]), P(wall), noise))

    def _add_anchors(
        self, graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, anchors: Anchors, anchor_of: dict[int, int],
        rooms: set[int],
    ) -> None:  # fmt: skip
        settings = self._config.anchors
        tight = factors.redescending_noise_of_plane(
            settings.sigma_normal, settings.sigma_offset, settings.redescending
        )
        # what is far off pulls as hard as what is near, where the map is bent
        bent = factors.noise_of_plane(settings.sigma_normal, settings.sigma_offset, self._config.backend.huber)
        loose = factors.noise_of_plane(settings.sigma_loose, settings.sigma_loose, self._config.backend.huber)
        start = gtsam.Pose3(anchors.T_map_bim)
        values.insert(_BIM, start)
        graph.add(gtsam.PriorFactorPose3(_BIM, start, factors.noise_of_pose(1.0, 100.0)))
        anchored = [
            (wall, p, noise) for held, noise in ((anchors.planes, tight), (anchors.bent, bent), (anchors.loose, loose))
            for wall, planned in held.items() for p in planned if wall in anchor_of
        ]  # fmt: skip
        for number, (wall, planned, noise) in enumerate(anchored, 1):
            _add_place(graph, values, W(number), planned.place)
            plane = planned.plane + np.array([0.0, 0.0, 0.0, planned.plane[:3] @ planned.place])
            graph.add(factors.anchor_plane(plane, W(number), X(anchor_of[wall]), P(wall), noise))
        for room, T_bim_room in anchors.rooms.items():
            if room in rooms:
                graph.add(factors.anchor_room(T_bim_room, _BIM, R(room), settings.sigma_normal, settings.sigma_room))
        if anchors.elevation is not None and values.exists(_FLOOR):
            level = factors.noise_of_plane(settings.sigma_normal, settings.sigma_floor, None)
            middle = np.array([*inverse(anchors.T_map_bim)[:2, 3], anchors.elevation])
            _add_place(graph, values, W(0), middle)
            graph.add(factors.storey_plane(0.0, W(0), X(0), _FLOOR, level))

    def _take(self, values: gtsam.Values, anchor_of: dict[int, int]) -> None:
        poses = np.stack([values.atPose3(X(i)).matrix() for i in range(len(self.keyframes))])
        for keyframe, pose in zip(self.keyframes, poses, strict=True):
            keyframe.T_map_sensor = pose
        self.planes_in_map = {
            wall: transform_planes(poses[anchor], values.atOrientedPlane3(P(wall)).planeCoefficients().ravel())
            for wall, anchor in anchor_of.items()
        }
        if values.exists(_FLOOR):
            self.floor_in_map = values.atOrientedPlane3(_FLOOR).planeCoefficients().ravel()
        self.T_map_bim = values.atPose3(_BIM).matrix() if values.exists(_BIM) else None


def _add_place(graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, key: int, place_in_bim: Floats) -> None:
    """A frame fixed in the BIM's, for anchors there: seen from the BIM's origin, a small turn of a far wall would pass
    for its offset."""
    T_bim_place = gtsam.Pose3(gtsam.Rot3(), place_in_bim)
    values.insert(key, values.atPose3(_BIM).compose(T_bim_place))
    graph.add(gtsam.BetweenFactorPose3(_BIM, key, T_bim_place, factors.noise_of_pose(1e-5, 1e-5)))
