"""Extra walls that are things of the plan other than walls: stairs, railings, beams, furniture."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from data.geometry.raycast import TriangleScene
from data.scene_graph import SceneGraph
from sgslam.as_built.deviation_entries import Deviation, ExtraDeviation
from sgslam.geometry.frames import transform_points

Floats = NDArray[np.float64]
_NEAR = 0.25  # m across the surface, within which the thing stands
_STEP = 0.1  # m between the places of a surface that are compared
_LEAST = 0.3  # of these places; a railing has gaps
_HEIGHT = 2.5  # m of a surface whose height is not known


def without_planned_things(
    deviations: Sequence[Deviation], s_graph: SceneGraph, T_bim_map: Floats, bodies: NDArray[np.float64]
) -> list[Deviation]:
    """The deviations without the extra walls at which one of the `bodies` (M, 3, 3), metres in the BIM frame, stands.
    `T_bim_map` is (4, 4)."""
    if not len(bodies):
        return list(deviations)
    scene = TriangleScene(bodies)
    return [d for d in deviations if d["kind"] != "extra" or not _is_planned(d, s_graph, T_bim_map, scene)]


def _is_planned(d: ExtraDeviation, s_graph: SceneGraph, T_bim_map: Floats, scene: TriangleScene) -> bool:
    surface = s_graph.surface_by_id[d["s_id"]]
    floor = next((f.elevation for f in s_graph.floors if f.id == surface.floor), None) or 0.0
    low, high = surface.height or (0.0, _HEIGHT)
    ends = np.array(surface.ends())
    along = np.linspace(0.0, 1.0, max(int((surface.length or 0.0) / _STEP), 2))[:, None]
    z = floor + np.arange(low + _STEP, high, 2 * _STEP)
    xy = np.repeat(ends[0] + along * (ends[1] - ends[0]), len(z), axis=0)
    places = transform_points(T_bim_map, np.column_stack([xy, np.tile(z, len(along))]))
    normal = T_bim_map[:3, :2] @ surface.normal
    reached = scene.distances(places + _NEAR * normal, np.tile(-normal, (len(places), 1)))
    at_column = (reached < 2 * _NEAR).reshape(len(along), -1).any(axis=1)
    return bool(at_column.mean() > _LEAST)
