"""The variables of the graph: their keys, and their values when an optimisation begins."""

from collections.abc import Iterable
from dataclasses import dataclass, field

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
    """The inputs of one optimisation: observations of walls and of level surfaces, rooms and anchors; and the keyframe
    in whose frame each wall and each level surface is estimated."""

    seen: list[SeenWall] = field(default_factory=list)
    levels: list[SeenLevel] = field(default_factory=list)
    rooms: list[RoomNode] = field(default_factory=list)
    anchors: Anchors | None = None
    anchor_of: dict[int, int] = field(default_factory=dict)
    anchor_of_level: dict[int, int] = field(default_factory=dict)

    @property
    def planned(self) -> dict[int, PlannedWall]:
        """The planned walls of all anchors, by the keys of their frames."""
        if self.anchors is None:
            return {}
        all_of_them = enumerate(planned_walls(self.anchors, self.anchor_of), len(self.anchors.elevations))
        return {W(number): planned for number, (_, planned) in all_of_them}


def start_values(
    graph: gtsam.NonlinearFactorGraph,
    inputs: GraphInputs,
    keyframes: list[KeyframeNode],
    planes_in_map: dict[int, Floats],
    levels_in_map: dict[int, Floats],
) -> gtsam.Values:
    """Start values of the variables of `graph`: the present estimates, else the first observation of each.

    Variables with neither are left out.
    """
    found: dict[int, gtsam.Pose3 | gtsam.OrientedPlane3] = dict.fromkeys([IDENTITY, SAME, LEVEL], gtsam.Pose3())
    found[GROUND] = gtsam.OrientedPlane3(0.0, 0.0, 1.0, 0.0)
    found |= {X(i): gtsam.Pose3(keyframe.T_map_sensor) for i, keyframe in enumerate(keyframes)}
    levels = _planes(((s.level, s) for s in inputs.levels), inputs.anchor_of_level, keyframes, levels_in_map)
    walls = _planes(((s.wall, s) for s in inputs.seen), inputs.anchor_of, keyframes, planes_in_map)
    found |= {F(level): plane for level, plane in levels.items()} | {P(wall): plane for wall, plane in walls.items()}
    for room in inputs.rooms:
        found[R(room.id)] = gtsam.Pose3(room.T_map_room)
    if (anchors := inputs.anchors) is not None:
        found[BIM] = bim = gtsam.Pose3(anchors.T_map_local)
        places = [p.place for _, p in planned_walls(anchors, inputs.anchor_of)]
        for number, place in enumerate([*middles(anchors).values(), *places]):
            found[W(number)] = bim.compose(gtsam.Pose3(gtsam.Rot3(), place))
    values = gtsam.Values()
    for key in graph.keyVector():
        if key in found:
            values.insert(key, found[key])
    return values


def _planes(
    seen: Iterable[tuple[int, SeenWall | SeenLevel]],
    anchor_of: dict[int, int],
    keyframes: list[KeyframeNode],
    known: dict[int, Floats],
) -> dict[int, gtsam.OrientedPlane3]:
    """The planes of surfaces by number, each in the frame of its keyframe."""
    in_map = {number: plane for number, plane in known.items() if number in anchor_of}
    for number, s in seen:
        if number in anchor_of and number not in in_map and np.isfinite(s.plane).all():
            in_map[number] = transform_planes(keyframes[s.keyframe].T_map_sensor, s.plane)
    T_anchor_map = {number: inverse(keyframes[anchor_of[number]].T_map_sensor) for number in in_map}
    return {n: gtsam.OrientedPlane3(transform_planes(T_anchor_map[n], plane)) for n, plane in in_map.items()}
