"""The variables of the graph: their keys, and their values when an optimisation begins."""

from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, F, L, O, P, R, U, W, X
from numpy.typing import NDArray

from sgslam.geometry.frames import inverse, transform_planes
from sgslam.mapping import Anchors, KeyframeNode, PlannedWall, RoomNode, SeenLevel, SeenWall

Floats = NDArray[np.float64]
BIM, LEVEL, GROUND = B(0), L(0), U(0)  # LEVEL is a frame; GROUND is the plane z = 0 in it
IDENTITY, SAME = O(0), O(1)  # a plane that is seen from its own frame is seen from IDENTITY, in the frame SAME


def middles(anchors: Anchors) -> dict[int, Floats]:
    """(3,) points in the BIM frame at each known level's height, below the origin of the map; frames W(0), W(1), ..."""
    xy = inverse(anchors.T_map_local)[:2, 3]
    return {level: np.array([*xy, z]) for level, (z, _) in sorted(anchors.elevations.items())}


def planned_walls(anchors: Anchors, anchor_of: dict[int, int]) -> list[tuple[int, PlannedWall]]:
    """(wall, planned wall) of all anchored walls in the graph; their frames are W(n), W(n + 1), ..., after those of the
    n level surfaces."""
    return [(wall, p) for wall, planned in anchors.planes.items() for p in planned if wall in anchor_of]


@dataclass(frozen=True)
class GraphInputs:
    """The inputs of one optimisation: observations of walls and of level surfaces, the keyframe in whose frame each of
    these is estimated, rooms and anchors. The observations are copies, since they are relabelled later."""

    seen: list[SeenWall]
    anchor_of: dict[int, int]
    levels: list[SeenLevel]
    anchor_of_level: dict[int, int]
    rooms: list[RoomNode]
    anchors: Anchors | None

    @property
    def planned(self) -> dict[int, PlannedWall]:
        """The planned walls of all anchors, by the keys of their frames."""
        if self.anchors is None:
            return {}
        all_of_them = enumerate(planned_walls(self.anchors, self.anchor_of), len(self.anchors.elevations))
        return {W(number): planned for number, (_, planned) in all_of_them}


def start_values(
    graph: gtsam.NonlinearFactorGraph, inputs: GraphInputs, keyframes: list[KeyframeNode],
    planes_in_map: dict[int, Floats], levels_in_map: dict[int, Floats],
) -> gtsam.Values:  # fmt: skip
    """Start values of the variables of `graph`: the present estimates, else the first observation of each.

    Variables with neither are left out.
    """
    found: dict[int, gtsam.Pose3 | gtsam.OrientedPlane3] = dict.fromkeys([IDENTITY, SAME, LEVEL], gtsam.Pose3())
    found[GROUND] = gtsam.OrientedPlane3(0.0, 0.0, 1.0, 0.0)
    found |= {X(i): gtsam.Pose3(keyframe.T_map_sensor) for i, keyframe in enumerate(keyframes)}
    for level in inputs.levels:
        anchor = inputs.anchor_of_level[level.level]
        if F(level.level) not in found and np.isfinite(level.plane).all():
            known = levels_in_map.get(level.level)
            in_map = transform_planes(keyframes[level.keyframe].T_map_sensor, level.plane) if known is None else known
            T_anchor_map = inverse(keyframes[anchor].T_map_sensor)
            found[F(level.level)] = gtsam.OrientedPlane3(transform_planes(T_anchor_map, in_map))
    for s in inputs.seen:
        keeper = inputs.anchor_of.get(s.wall)
        if keeper is not None and P(s.wall) not in found and np.isfinite(s.plane).all():
            known = planes_in_map.get(s.wall)
            in_map = transform_planes(keyframes[s.keyframe].T_map_sensor, s.plane) if known is None else known
            T_anchor_map = inverse(keyframes[keeper].T_map_sensor)
            found[P(s.wall)] = gtsam.OrientedPlane3(transform_planes(T_anchor_map, in_map))
    for room in inputs.rooms:
        found[R(room.id)] = gtsam.Pose3(room.T_map_room)
    anchors = inputs.anchors
    if anchors is not None:
        found[BIM] = bim = gtsam.Pose3(anchors.T_map_local)
        places = [p.place for _, p in planned_walls(anchors, inputs.anchor_of)]
        for number, place in enumerate([*middles(anchors).values(), *places]):
            found[W(number)] = bim.compose(gtsam.Pose3(gtsam.Rot3(), place))
    values = gtsam.Values()
    for key in graph.keyVector():
        if key in found:
            values.insert(key, found[key])
    return values
