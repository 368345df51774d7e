"""Moves a scene graph in the plane, or mirrors it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from data.geometry import se2
from data.geometry.se2 import Array
from data.scene_graph.graph import SceneGraph
from data.scene_graph.nodes import Room, WallSurface, Xy

MIRRORED = ", mirrored"  # added to the name of a frame
Pose = tuple[float, float, float, float, float, float, float]  # x y z, and a quaternion qx qy qz qw


def moved(graph: SceneGraph, T_out_graph: Array) -> SceneGraph:
    """Moves rooms, wall surfaces and doors by (yaw, x, y) in rad and m: p_out = R(yaw) p_graph + (x, y).

    Ids, order and the frame's name stay; `plane`s, level surfaces and keyframes are left out.
    """
    T = np.asarray(T_out_graph, dtype=float)

    def at(point: Xy) -> Xy:
        x, y = se2.apply(T, np.array(point)).tolist()
        return x, y

    def turned(normal: Xy) -> Xy:
        x, y = se2.rotate(float(T[0]), np.array(normal)).tolist()
        return x, y

    return _mapped(graph, at, turned)


def mirrored(graph: SceneGraph) -> SceneGraph:
    """The mirror image: y becomes -y, of the sensor's axes too. Ids and order stay, the frame's name says it; `plane`s
    and level surfaces are left out."""

    def flipped(point: Xy) -> Xy:
        return point[0], -point[1]

    image = _mapped(graph, flipped, flipped)
    rooms = tuple(replace(r, polygon=None if r.polygon is None else r.polygon[::-1]) for r in image.rooms)
    walls = tuple(
        replace(w, parts=tuple((source, -b, -a, full) for source, a, b, full in reversed(w.parts)))
        for w in image.wall_surfaces
    )
    keyframes = tuple(replace(k, pose=_flipped_pose(*k.pose)) for k in graph.keyframes)
    frame = graph.frame.removesuffix(MIRRORED) if graph.frame.endswith(MIRRORED) else graph.frame + MIRRORED
    return replace(image, frame=frame, rooms=rooms, wall_surfaces=walls, keyframes=keyframes)


def _flipped_pose(x: float, y: float, z: float, qx: float, qy: float, qz: float, qw: float) -> Pose:
    return x, -y, z, -qx, qy, -qz, qw


def _mapped(graph: SceneGraph, at: Callable[[Xy], Xy], turned: Callable[[Xy], Xy]) -> SceneGraph:
    def room(r: Room) -> Room:
        return replace(r, centroid=at(r.centroid), polygon=None if r.polygon is None else tuple(map(at, r.polygon)))

    def wall(w: WallSurface) -> WallSurface:
        return replace(w, centroid=at(w.centroid), normal=turned(w.normal), plane=None)

    doors = tuple(replace(d, centroid=at(d.centroid)) for d in graph.doors)
    rooms, walls = tuple(map(room, graph.rooms)), tuple(map(wall, graph.wall_surfaces))
    return SceneGraph(graph.frame, rooms, walls, doors, graph.floors)
