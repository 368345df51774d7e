"""Moves a scene graph in the plane."""

from dataclasses import replace

import numpy as np

from data.geometry import se2
from data.geometry.se2 import Array
from data.scene_graph.graph import SceneGraph, Xy


def moved(graph: SceneGraph, T_out_graph: Array) -> SceneGraph:
    """Moves rooms, wall surfaces and doors by (yaw, x, y) in rad and m: p_out = R(yaw) p_graph + (x, y).

    Ids, order and the frame's name stay; `plane`s and keyframes are left out.
    """
    T = np.asarray(T_out_graph, dtype=float)

    def at(point: Xy) -> Xy:
        x, y = se2.apply(T, np.array(point)).tolist()
        return x, y

    def turned(normal: Xy) -> Xy:
        x, y = se2.rotate(float(T[0]), np.array(normal)).tolist()
        return x, y

    return SceneGraph(
        graph.frame,
        tuple(
            replace(r, centroid=at(r.centroid), polygon=None if r.polygon is None else tuple(map(at, r.polygon)))
            for r in graph.rooms
        ),
        tuple(
            replace(w, centroid=at(w.centroid), normal=turned(w.normal), plane=None) for w in graph.wall_surfaces
        ),
        tuple(replace(d, centroid=at(d.centroid)) for d in graph.doors),
        graph.floors,
    )  # fmt: skip
