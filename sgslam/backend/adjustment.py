"""The last adjustment of an anchored map: points on planned walls take the place of the walls' anchors.

A fifth of the walls can be left out: how far these then stand off the plan checks the place and the shape of the map.
"""

import logging
from collections.abc import Iterator, Sequence
from functools import cached_property

import gtsam
import numpy as np
from gtsam.symbol_shorthand import C, P, V, X
from numpy.typing import NDArray

import factors
from sgslam.backend.covariances import Uncertainty
from sgslam.backend.graph_builder import GraphBuilder, offset_priors, point_factors, redescending, robust_weights
from sgslam.backend.held_factors import HeldFactors, Key, Kind, graph_of
from sgslam.backend.variables import BIM, GraphInputs
from sgslam.config import Config
from sgslam.geometry.frames import inverse, transform_planes, transform_points
from sgslam.mapping.keyframes import ControlSight, PlannedWall
from sgslam.mapping.wall_points import Faces, WallPoints
from sgslam.types import HeldOutWall

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
# of the place on which the walls agree: rad and m, of heading and in plan view; tilt and height are free
_PLACE = np.array([1.0, 1.0, 0.002, 0.02, 0.02, 1.0])
_FOLDS = 5  # shares of the walls that are left out in turn


class Adjustment:
    """Graphs from held factors; `start` has their values, and gets those of walls' offsets and of control points.

    What lies far off at the first optimum, the only one of its graph, counts less from then on.
    """

    def __init__(
        self,
        held: HeldFactors,
        builder: GraphBuilder,
        inputs: GraphInputs,
        start: gtsam.Values,
        faces: Faces,
        seen: WallPoints,
        control: Sequence[ControlSight],
        config: Config,
    ) -> None:
        self._held, self._builder, self._inputs, self._settings = held, builder, inputs, config.anchors
        self._sigma_wall = config.backend.sigma_wall
        self._faces, self._seen, self._control, self.start = faces, seen, control, start
        self._walls = sorted(set(faces.wall[seen.face].tolist()))
        self._body_of = dict(zip(faces.surface, faces.body, strict=True))
        for wall in self._walls:
            start.insert(V(wall), np.zeros(1))
        for i, sight in enumerate(control):
            start.insert(C(i), start.atPose3(X(sight.keyframe)).compose(gtsam.Pose3(gtsam.Rot3(), sight.in_sensor)))
        self._weights, self._offsets = np.ones(len(seen.face)), np.zeros(len(self._walls))
        # weights of the control points, from where walls and levels have them: all of them may be wrong alike
        self._trust = redescending(self._control_off(start))
        self._points = list[gtsam.NonlinearFactor]()

    def graphs(
        self, without: frozenset[str] = frozenset()
    ) -> tuple[gtsam.NonlinearFactorGraph, gtsam.NonlinearFactorGraph]:
        """What is known of the poses, and that with what makes the map more rigid; `without` some walls."""
        if not without:
            self._points = list(point_factors(self._faces, self._seen, self.start, self._settings, self._weights))
        kept = np.array([self._faces.body[face] not in without for face in self._seen.face.tolist()], dtype=bool)
        known = gtsam.NonlinearFactorGraph()
        for k in np.flatnonzero(kept).tolist():
            known.add(self._points[k])
        there = np.isin(self._walls, self._faces.wall[self._seen.face[kept]])
        walls = [wall for wall, is_there in zip(self._walls, there, strict=True) if is_there]
        priors = offset_priors(walls, self._settings.sigma_offset, self._offsets[there])
        for factor in (*priors, *self._control_factors()):
            known.add(factor)
        # walls were extracted from the same points, which count once
        others = graph_of(self._held, lambda kind, key: kind not in ("wall", "room") and not _anchors_wall(kind, key))
        known.push_back(others)
        whole = gtsam.NonlinearFactorGraph(known)
        # the walls themselves make the map more rigid, and their directions upright
        whole.push_back(graph_of(self._held, lambda kind, key: kind in ("wall", "room")))
        left_out = {surface for surface, body in self._body_of.items() if body in without}
        for factor in self._builder.directions(self._inputs, left_out):
            whole.add(factor)
        # where most walls are moved the place that the walls agree on holds
        whole.add(gtsam.PriorFactorPose3(BIM, self.start.atPose3(BIM), gtsam.noiseModel.Diagonal.Sigmas(_PLACE)))
        return known, whole

    def _control_factors(self) -> Iterator[gtsam.NonlinearFactor]:
        """Each point is a frame at its place in the sensor's frame, and its place in the plan is measured."""
        bim = self.start.atPose3(BIM)
        for i, (sight, weight) in enumerate(zip(self._control, self._trust.tolist(), strict=True)):
            T_bim_frame = bim.between(self.start.atPose3(C(i))).matrix()
            T_bim_frame[:3, 3] = sight.place
            yield factors.frame_at(sight.in_sensor, X(sight.keyframe), C(i), 1e-4)
            yield factors.anchor_point(T_bim_frame, BIM, C(i), sight.sigma / np.sqrt(weight))

    def reweight(self, values: gtsam.Values) -> None:
        """Weighs walls, points and control points by how far they lie off at an optimum of the last graph."""
        self._offsets = np.array([values.atVector(V(wall))[0] for wall in self._walls])
        errors = np.array([factor.error(values) for factor in self._points])
        self._weights = robust_weights(np.sqrt(2 * errors / self._weights))
        self._trust = redescending(self._control_off(values))

    def _control_off(self, values: gtsam.Values) -> Floats:
        """How far each control point is off its place, in standard deviations."""
        bim = values.atPose3(BIM)
        found = [bim.transformTo(values.atPose3(C(i)).translation()) for i in range(len(self._control))]
        off = [np.linalg.norm(at - own.place) / own.sigma for at, own in zip(found, self._control, strict=True)]
        return np.array(off, dtype=float)

    def held_out(self, values: gtsam.Values) -> tuple[HeldOutWall, ...]:
        """How far each matched wall stands off the plan in an optimum that knows nothing of it: fifth by fifth they are
        left out, beginning at `values`. Empty where there are too few walls, or no optimum."""
        # in the order of their directions, so that of each direction most are left
        turns = {body: np.arctan2(*own[0][1].plane[1::-1]) % np.pi for body, own in self._matched.items()}
        ordered = sorted(self._matched, key=lambda body: (round(turns[body], 1) % round(np.pi, 1), body))
        found = list[HeldOutWall]()
        for fold in range(_FOLDS if len(ordered) >= _FOLDS else 0):
            chosen = frozenset(ordered[fold::_FOLDS])
            known, whole = self.graphs(chosen)
            start = gtsam.Values(values)
            for key in set(start.keys()) - set(whole.keyVector()):
                start.erase(key)
            parameters = gtsam.LevenbergMarquardtParams()
            parameters.setRelativeErrorTol(1e-4)
            try:
                optimum = gtsam.LevenbergMarquardtOptimizer(whole, start, parameters).optimize()
                covariances = Uncertainty(known, optimum, None)
            except RuntimeError as error:
                _log.warning("no walls are held out: %s", error)
                return ()
            found += [
                self._off_plan(*pair, optimum, covariances) for body in sorted(chosen) for pair in self._matched[body]
            ]
        return tuple(found)

    @cached_property
    def _matched(self) -> dict[str, list[tuple[int, PlannedWall]]]:
        """The mapped walls near the planned surfaces of each body, whether they agree with it or not."""
        found: dict[str, list[tuple[int, PlannedWall]]] = {}
        for _, wall, planned in self._inputs.wall_frames:
            if planned.a_id in self._body_of:
                found.setdefault(self._body_of[planned.a_id], []).append((wall, planned))
        return found

    def _off_plan(self, wall: int, planned: PlannedWall, values: gtsam.Values, known: Uncertainty) -> HeldOutWall:
        """How far a mapped wall stands off, with its standard deviation: of the poses, of what was measured, and of
        what was built."""
        bim, keyframe = values.atPose3(BIM), X(self._inputs.anchor_of[wall])
        T_local_sensor = bim.between(values.atPose3(keyframe)).matrix()
        mapped = transform_planes(T_local_sensor, values.atOrientedPlane3(P(wall)).planeCoefficients().ravel())
        offset = float((planned.plane - mapped) @ [*planned.place, 1.0])
        place, normal, T_sensor_local = planned.place, planned.plane[:3], inverse(T_local_sensor)
        n, at = T_sensor_local[:3, :3] @ normal, transform_points(T_sensor_local, place)
        moves = {keyframe: np.array([*np.cross(at, n), *n]), BIM: -np.array([*np.cross(place, normal), *normal])}
        settings = self._settings
        built = settings.sigma_offset**2 + settings.sigma_extraction**2 + self._sigma_wall**2
        return HeldOutWall(planned.a_id, offset, float(np.sqrt(known.variance(moves) + built)))


def _anchors_wall(kind: Kind, key: Key) -> bool:
    """Whether a factor anchors a wall or a room; a frame at a planned wall has the key of its anchor, and "place"."""
    return kind == "anchor" and key[0] in ("wall", "room") and key[-1] != "place"
