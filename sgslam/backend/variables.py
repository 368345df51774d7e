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
    def level_frames(self) -> list[tuple[int, int, Floats]]:
        """The key of the frame on each planned floor or ceiling, the number of the level surface, and (3,) the frame's
        place in the BIM frame, below the origin of the map."""
        if self.anchors is None:
            return []
        xy, known = inverse(self.anchors.T_map_local)[:2, 3], sorted(self.anchors.elevations.items())
        return [(W(number), level, np.array([*xy, z])) for number, (level, (z, _)) in enumerate(known)]

    @property
    def wall_frames(self) -> list[tuple[int, int, PlannedWall]]:
        """The key of the frame near each anchored wall in the graph, the wall's number, and the planned one."""
        if self.anchors is None:
            return []
        known = ((wall, p) for wall, planned in self.anchors.planes.items() for p in planned if wall in self.anchor_of)
        return [(W(number), *own) for number, own in enumerate(known, len(self.anchors.elevations))]


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
        frames = [*inputs.level_frames, *((frame, wall, p.place) for frame, wall, p in inputs.wall_frames)]
        found |= {frame: bim.compose(gtsam.Pose3(gtsam.Rot3(), place)) for frame, _, place in frames}
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
        if number in anchor_of and number not in in_map:
            in_map[number] = transform_planes(keyframes[s.keyframe].T_map_sensor, s.plane)
    T_anchor_map = {number: inverse(keyframes[anchor_of[number]].T_map_sensor) for number in in_map}
    return {n: gtsam.OrientedPlane3(transform_planes(T_anchor_map[n], plane)) for n, plane in in_map.items()}
