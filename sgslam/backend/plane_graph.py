"""Anchors a finished graph of keyframes and planes, such as S-Graphs saves, to a plan.

The result is another system's map in building coordinates.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, O, P, X
from numpy.typing import NDArray

import factors
from data.scene_graph import WallSurface
from data.scene_graph.g2o import PlaneGraph
from sgslam.geometry.frames import inverse, local_coordinates, transform_planes

Floats = NDArray[np.float64]
_HUBER, _REDESCENDING = 1.345, 3.0
_FRAME = np.array([1.0, 1.0, 1.0, 100.0, 100.0, 1.0])  # rad, m: sigmas of the prior of the BIM frame
_VECTOR_OF_ANGLE = np.diag([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])  # a quaternion's vector part is half an angle


@dataclass(frozen=True, eq=False)
class AnchoredPlaneGraph:
    """Keyframes as T_bim_sensor (4, 4) and planes (4,) in the BIM frame, by their ids; T_map_bim (4, 4)."""

    keyframes: dict[int, Floats]
    planes: dict[int, Floats]
    T_map_bim: Floats


def anchor_plane_graph(
    graph: PlaneGraph, pairs: Sequence[tuple[int, WallSurface]], T_bim_map: Floats, sigma_offset: float = 0.02,
    sigma_normal: float = 0.01,
) -> AnchoredPlaneGraph:  # fmt: skip
    """Optimises the graph with anchors from its planes to planned wall surfaces of `pairs` (plane id, surface).

    `T_bim_map` (4, 4) is the place of the map from a match. The sigmas (m, rad) are those of the building against its
    plan. Anchors and observations have robust losses. Of the file's information matrices only the proportions are used;
    their common factor is estimated from the residuals (a posteriori variance of unit weight).

    The plan is taken to be level at z = 0, within a metre of the height that `T_bim_map` gives. A plane fitted to a
    strip of wall leans by the sensor's bias and is right at one height only. Where all walls lean, that height is
    found; walls determine no other height.
    """
    name = {plane: plane for plane in graph.planes} | {b: a for a, b in graph.same}  # planes that are one wall
    keeper: dict[int, int] = {}
    for seen in graph.seen:
        keeper.setdefault(name[seen.plane], seen.keyframe)
    factor_graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    _add_poses(graph, factor_graph, values)
    _add_planes(graph, factor_graph, values, name, keeper)
    T_map_bim = gtsam.Pose3(inverse(T_bim_map))
    values.insert(B(0), T_map_bim)
    factor_graph.add(gtsam.PriorFactorPose3(B(0), T_map_bim, gtsam.noiseModel.Diagonal.Sigmas(_FRAME)))
    held = [
        (_planned(surface, transform_planes(T_bim_map, graph.planes[plane])), name[plane])
        for plane, surface in pairs if name[plane] in keeper
    ]  # fmt: skip
    for noise in (  # a redescending loss only works from near the optimum
        factors.noise_of_plane(sigma_normal, sigma_offset, _HUBER),
        factors.redescending_noise_of_plane(sigma_normal, sigma_offset, _REDESCENDING),
    ):
        anchored = gtsam.NonlinearFactorGraph(factor_graph)
        for planned, plane in held:
            anchored.add(factors.anchor_plane(planned, B(0), X(keeper[plane]), P(plane), noise))
        values = gtsam.LevenbergMarquardtOptimizer(anchored, values).optimize()
    return _result(graph, values, name, keeper)


def _planned(surface: WallSurface, seen_in_bim: Floats) -> Floats:
    """(4,) the planned plane with its normal towards the side that was seen."""
    planned = factors.plane_from_wall(surface.normal, surface.centroid)
    planned /= np.linalg.norm(planned[:3])
    return planned if planned[:3] @ seen_in_bim[:3] > 0 else -planned


def _add_poses(graph: PlaneGraph, factor_graph: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> None:
    tight = factors.noise_of_pose(1e-5, 1e-5)
    for key, pose in ((O(0), gtsam.Pose3()), *((X(i), gtsam.Pose3(T)) for i, T in graph.keyframes.items())):
        values.insert(key, pose)
    for key in (O(0), X(min(graph.keyframes))):
        factor_graph.add(gtsam.PriorFactorPose3(key, values.atPose3(key), tight))
    for step, information in zip(graph.steps, _informations_of_steps(graph), strict=True):
        noise = gtsam.noiseModel.Gaussian.Information(information / _variance(graph))
        factor_graph.add(
            gtsam.BetweenFactorPose3(X(step.first), X(step.second), gtsam.Pose3(step.T_first_second), noise)
        )


def _add_planes(
    graph: PlaneGraph, factor_graph: gtsam.NonlinearFactorGraph, values: gtsam.Values, name: dict[int, int],
    keeper: dict[int, int],
) -> None:  # fmt: skip
    unit = np.sqrt(_variance(graph))
    for seen in graph.seen:
        plane, weight = name[seen.plane], np.diag(seen.information)
        normal, offset = unit / np.sqrt(weight[:2].mean()), unit / np.sqrt(weight[2])
        anchor = keeper[plane]
        if not values.exists(P(plane)):
            values.insert(P(plane), gtsam.OrientedPlane3(seen.plane_in_sensor))
        if seen.keyframe == anchor:
            noise = factors.noise_of_plane(normal, offset, None)
            factor_graph.add(factors.observe_own_plane(seen.plane_in_sensor, O(0), P(plane), noise))
        else:
            robust = factors.noise_of_plane(normal, offset, _HUBER)
            factor_graph.add(factors.observe_plane(seen.plane_in_sensor, X(seen.keyframe), X(anchor), P(plane), robust))


def _informations_of_steps(graph: PlaneGraph) -> list[Floats]:
    """(6, 6) information of each step: rotation (rad) first, then translation (m)."""
    order = [3, 4, 5, 0, 1, 2]
    scaled = [_VECTOR_OF_ANGLE @ step.information @ _VECTOR_OF_ANGLE for step in graph.steps]
    return [information[np.ix_(order, order)] for information in scaled]


def _variance(graph: PlaneGraph) -> float:
    """The variance of unit weight: the squared residuals at the graph's own estimates per degree of freedom."""
    total, count = 0.0, -6 * (len(graph.keyframes) - 1) - 3 * len({seen.plane for seen in graph.seen})
    for step, information in zip(graph.steps, _informations_of_steps(graph), strict=True):
        predicted = inverse(graph.keyframes[step.first]) @ graph.keyframes[step.second]
        residual = local_coordinates(step.T_first_second, predicted)
        total, count = total + float(residual @ information @ residual), count + 6
    for seen in graph.seen:
        predicted = transform_planes(inverse(graph.keyframes[seen.keyframe]), graph.planes[seen.plane])
        residual = gtsam.OrientedPlane3(seen.plane_in_sensor).localCoordinates(gtsam.OrientedPlane3(predicted))
        total, count = total + float(residual @ seen.information @ residual), count + 3
    return total / count if count > 0 else 1.0  # without redundancy the file's own information is used


def _result(
    graph: PlaneGraph, values: gtsam.Values, name: dict[int, int], keeper: dict[int, int]
) -> AnchoredPlaneGraph:
    T_map_bim = values.atPose3(B(0)).matrix()
    T_bim_map = inverse(T_map_bim)
    keyframes = {i: T_bim_map @ values.atPose3(X(i)).matrix() for i in graph.keyframes}
    planes = {}
    for plane in graph.planes:
        if name[plane] in keeper:
            local = values.atOrientedPlane3(P(name[plane])).planeCoefficients().ravel()
            planes[plane] = transform_planes(keyframes[keeper[name[plane]]], local)
    return AnchoredPlaneGraph(keyframes, planes, T_map_bim)
