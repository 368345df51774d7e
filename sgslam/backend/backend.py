"""The back end: batch optimisation of keyframes, walls, level surfaces, rooms and the BIM frame, warm started.

Each optimisation builds its graph from the factors that hold. So walls can be joined and anchors withdrawn without
editing a graph.
"""

import logging
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import gtsam
import numpy as np
from gtsam.symbol_shorthand import F, P, X
from numpy.typing import NDArray

from data.common.bars import steps
from sgslam.backend.adjustment import Adjustment
from sgslam.backend.covariances import Uncertainty
from sgslam.backend.graph_builder import GraphBuilder
from sgslam.backend.held_factors import KINDS, HeldFactors, graph_of
from sgslam.backend.variables import BIM, GraphInputs, start_values
from sgslam.config import Config
from sgslam.geometry.frames import inverse, transform_planes
from sgslam.mapping import Anchors, Closure, KeyframeNode, PlannedWall, RoomNode, SeenLevel, SeenWall
from sgslam.mapping.keyframes import ControlSight
from sgslam.mapping.wall_points import Faces, WallPoints
from sgslam.types import HeldOutWall

Floats = NDArray[np.float64]
_log = logging.getLogger(__name__)
_REWEIGHTED = 3  # optimisations with points; a fourth moves nothing by a millimetre
_BELIEVABLE = 1e4  # largest error for each factor at an optimum: a hundred sigma


class Backend:
    """Estimates of keyframes, walls, level surfaces and T_map_local, from the factors that are `held`.

    `planes_in_map` and `levels_in_map` are planes (4,) by the numbers of walls and level surfaces; `T_map_local` (4, 4)
    is None while the map is not anchored. `closures` are the loop closures that hold; `LoopCloser` adds and removes
    them.
    """

    def __init__(self, config: Config) -> None:
        self._config = config
        self.keyframes: list[KeyframeNode] = []
        self.planes_in_map: dict[int, Floats] = {}
        self.levels_in_map: dict[int, Floats] = {}
        self.T_map_local: Floats | None = None
        self.closures: list[Closure] = []
        self.held: HeldFactors = {kind: {} for kind in KINDS}
        self._builder = GraphBuilder(config, self.keyframes, self.held)
        self._optimised_at = 0
        self._inputs = GraphInputs()  # of the last optimisation
        self._optimum: tuple[gtsam.NonlinearFactorGraph, gtsam.Values, dict[int, PlannedWall]] | None = None

    def add_keyframe(self, keyframe: KeyframeNode) -> None:
        """Adds a keyframe, tied to the one before it by the odometry between them."""
        self.keyframes.append(keyframe)
        if len(self.keyframes) == 1:
            self._builder.hold_begin(keyframe.T_map_sensor)
        else:
            self._builder.hold_step(len(self.keyframes) - 1, self._step(len(self.keyframes) - 1))

    def take_steps(self, begin: Floats) -> None:
        """Holds the steps of the odometry again, as the keyframes' tracked motion has changed, and fixes the first
        keyframe at its pose `begin` (4, 4) in the map: were it fixed where it was, its own error would tilt the map."""
        self._builder.hold_begin(begin)
        self._hold_steps()

    def _hold_steps(self) -> None:
        for i in [int(key[0]) for key in self.held["odometry"]]:
            self._builder.hold_step(i, self._step(i))

    def __getstate__(self) -> dict[str, Any]:
        """The attributes, without factors, which the next optimisation makes again."""
        placed, keys = (self._builder.begin, self._builder.found), {k: dict.fromkeys(f) for k, f in self.held.items()}
        return {**vars(self), "_optimum": None, "_inputs": GraphInputs(), "_builder": placed, "held": keys}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Makes the factors of the odometry and of the places again."""
        begin, found = state.pop("_builder")
        vars(self).update(state)
        self._builder = GraphBuilder(self._config, self.keyframes, self.held)
        if self.keyframes:
            self._builder.hold_begin(begin)
        for i, place in found.items():
            self._builder.hold_place(i, place)
        self._hold_steps()

    def absorb(self, other: "Backend", T_map_other: Floats, scans: int, storeys: dict[int, int], levels: int) -> None:
        """Adds the keyframes of another map at `T_map_other` (4, 4), with the factors between them.

        `scans` is added to their scan numbers, `levels` to those of level surfaces; `storeys` maps their floor numbers
        to those here.
        """
        first = len(self.keyframes)
        for i, keyframe in enumerate(other.keyframes):
            storey = None if keyframe.storey is None else storeys[keyframe.storey]
            T = T_map_other @ keyframe.T_map_sensor
            self.keyframes.append(replace(keyframe, scan=keyframe.scan + scans, T_map_sensor=T, storey=storey))
            if i == 0 or i in other._builder.found:
                self._builder.hold_place(first + i, T)
            else:
                self._builder.hold_step(first + i, other._step(i))
        self.closures += [replace(c, earlier=c.earlier + first, later=c.later + first) for c in other.closures]
        for number, plane in other.levels_in_map.items():
            self.levels_in_map[number + levels] = transform_planes(T_map_other, plane)

    def _step(self, i: int) -> Floats:
        """(4, 4) the tracked motion from keyframe i - 1 to keyframe i."""
        return inverse(self.keyframes[i - 1].T_track_sensor) @ self.keyframes[i].T_track_sensor

    @property
    def poses(self) -> Floats:
        """(K, 4, 4) T_map_sensor of all keyframes."""
        return np.array([k.T_map_sensor for k in self.keyframes]).reshape(-1, 4, 4)

    @property
    def estimates(self) -> tuple[Floats, dict[int, Floats], dict[int, Floats]]:
        """`poses`, and the planes (4,) in the map of walls and of level surfaces."""
        return self.poses, self.planes_in_map, self.levels_in_map

    @property
    def due(self) -> bool:
        """Whether the graph has grown enough since the last optimisation.

        The growth is a share of the graph, so that the total cost stays in proportion to the length of the run.
        """
        settings = self._config.backend
        grown = len(self.keyframes) - self._optimised_at
        return grown >= max(settings.every_keyframes, settings.growth * len(self.keyframes))

    def optimise(
        self,
        seen: list[SeenWall],
        levels: list[SeenLevel],
        rooms: list[RoomNode],
        anchors: Anchors | None,
        steps: int = 6,
    ) -> None:
        """Updates the factors and moves the estimates to the optimum of their graph, in at most `steps` iterations.

        If the optimizer fails, it runs again without the anchors. If that fails too, the last estimates are kept, which
        the odometry continues. Each failure is logged as a warning.
        """
        anchor_of, anchor_of_level = self._builder.hold_walls(seen), self._builder.hold_levels(levels)
        self._inputs = GraphInputs(seen, levels, rooms, anchors, anchor_of, anchor_of_level)
        self._builder.hold_rooms(rooms, anchor_of)
        self._builder.hold_loops(self.closures)
        self._builder.hold_anchors(self._inputs)
        self._optimised_at = len(self.keyframes)
        failure = self._solve(steps)
        if failure and anchors is not None:
            _log.warning("the optimisation of %d keyframes with anchors failed: %s", len(self.keyframes), failure)
            self.held["anchor"] = {}
            self._inputs = replace(self._inputs, anchors=None)
            failure = self._solve(steps)
        if failure:
            kept = "the last estimates are kept"
            _log.warning("the optimisation of %d keyframes failed: %s; %s", len(self.keyframes), failure, kept)

    def refine(self, faces: Faces, seen: WallPoints, control: Sequence[ControlSight] = ()) -> tuple[HeldOutWall, ...]:
        """Moves the estimates of an anchored map to the optimum of a graph in which points on planned walls take the
        place of the anchors of rooms, and of walls but for their directions, and with `control` points. The held
        factors stay as they are. Returns how far walls stand off the plan that another optimum leaves out."""
        inputs = self._inputs
        assert inputs.anchors is not None and self.T_map_local is not None
        start = self._start(graph_of(self.held))
        start.update(BIM, gtsam.Pose3(self.T_map_local))  # where the points were seen from, not where it was before
        given = self.held, self._builder, inputs, start, faces, seen, control, self._config
        adjustment, values = Adjustment(*given), start
        for _ in steps(range(_REWEIGHTED), "adjustment"):
            known, graph = adjustment.graphs()
            if failure := self._solve(20, graph, values):
                _log.warning("the adjustment of %d keyframes failed: %s", len(self.keyframes), failure)
                return ()
            assert self._optimum is not None
            values = self._optimum[1]
            self._optimum = known, *self._optimum[1:]
            adjustment.reweight(values)
        return adjustment.held_out(values)

    def _start(self, graph: gtsam.NonlinearFactorGraph) -> gtsam.Values:
        return start_values(graph, self._inputs, self.keyframes, self.planes_in_map, self.levels_in_map)

    def _solve(
        self, steps: int, graph: gtsam.NonlinearFactorGraph | None = None, values: gtsam.Values | None = None
    ) -> str | None:
        """Moves the estimates to the optimum of a graph, by default of all held factors, or returns why they stay."""
        graph = graph_of(self.held) if graph is None else graph
        parameters = gtsam.LevenbergMarquardtParams()
        parameters.setMaxIterations(steps)
        parameters.setRelativeErrorTol(1e-4)
        try:
            values = self._start(graph) if values is None else values
            optimizer = gtsam.LevenbergMarquardtOptimizer(graph, values, parameters)
            result = optimizer.optimize()
        except RuntimeError as error:
            return str(error).strip().partition("\n")[0] or "GTSAM gives no reason"
        if not np.isfinite(optimizer.error()):
            return "its error is not finite"
        if optimizer.error() > _BELIEVABLE * graph.size():
            return f"its error of {optimizer.error():.1e} is implausibly large"
        self._take(result)
        self._optimum = graph, result, {frame: planned for frame, _, planned in self._inputs.wall_frames}
        return None

    @property
    def newest_in_optimum(self) -> int | None:
        """The newest keyframe of the last successful optimisation of this process; None before the first."""
        if self._optimum is None:
            return None
        return next(k for k in reversed(range(len(self.keyframes))) if self._optimum[1].exists(X(k)))

    def uncertainty(self) -> Uncertainty | None:
        """The covariances of the last successful optimisation; None where there was none, or a variable is free."""
        if self._optimum is None:
            return None
        try:
            return Uncertainty(*self._optimum)
        except RuntimeError as error:
            _log.warning("there are no covariances: %s", error)
            return None

    def _take(self, values: gtsam.Values) -> None:
        for i, keyframe in enumerate(self.keyframes):
            keyframe.T_map_sensor = values.atPose3(X(i)).matrix()

        def in_map(symbol: Callable[[int], int], anchor_of: dict[int, int]) -> dict[int, Floats]:
            planes = {n: values.atOrientedPlane3(symbol(n)) for n in anchor_of if values.exists(symbol(n))}
            return {
                n: transform_planes(self.keyframes[anchor_of[n]].T_map_sensor, plane.planeCoefficients().ravel())
                for n, plane in planes.items()
            }

        self.planes_in_map = in_map(P, self._inputs.anchor_of)
        self.levels_in_map = in_map(F, self._inputs.anchor_of_level)
        self.T_map_local = values.atPose3(BIM).matrix() if values.exists(BIM) else None
