"""Factors of points on planned walls: each mean of what a keyframe saw of a face, and how far walls stand off the plan.

Most walls stand as planned, some far from it: offsets have a Laplace distribution, whose optimum is the least sum of
absolute values. A moved wall then pulls no more than one that is off by millimetres, and, unlike with redescending
losses, there is one optimum.
"""

from collections.abc import Iterator

import gtsam
import numpy as np
from gtsam.symbol_shorthand import V, X
from numpy.typing import NDArray

from sgslam.backend.variables import BIM
from sgslam.config import AnchorSettings
from sgslam.config.sensor import SENSOR
from sgslam.geometry.frames import inverse
from sgslam.mapping.wall_points import Faces, WallPoints

Floats = NDArray[np.float64]
_SMOOTH = 0.001  # m, below which an offset counts as its square


def point_factors(
    faces: Faces, seen: WallPoints, values: gtsam.Values, settings: AnchorSettings
) -> Iterator[gtsam.NonlinearFactor]:
    """A linear factor for each mean of points: n . p + d = the wall's offset V(wall), where p follows the keyframe's
    pose T_map_sensor and T_map_local, both at their `values`. Points of a face in one keyframe share an error."""
    sigma = np.hypot(SENSOR.range_noise / np.sqrt(seen.count), settings.sigma_extraction)
    for i, (face, keyframe) in enumerate(zip(seen.face.tolist(), seen.keyframe.tolist(), strict=True)):
        T_sensor_bim = values.atPose3(X(keyframe)).inverse().compose(values.atPose3(BIM)).matrix()
        # at the sensor's height: walls are not so plumb that the mean of some points would show the sensor's tilt
        place = np.array([*seen.place[i], inverse(T_sensor_bim)[2, 3]])
        normal = np.array([*faces.normal[face], 0.0])
        there = np.concatenate([np.cross(place, normal), normal])  # of a motion of the BIM frame
        n, p = T_sensor_bim[:3, :3] @ normal, T_sensor_bim[:3, :3] @ place + T_sensor_bim[:3, 3]
        here = np.concatenate([np.cross(p, n), n])  # of a motion of the sensor, in its own axes
        keys = X(keyframe), here[None], BIM, -there[None], V(int(faces.wall[face])), -faces.sign[face : face + 1, None]
        noise = gtsam.noiseModel.Isotropic.Sigma(1, float(sigma[i]))
        yield gtsam.LinearContainerFactor(gtsam.JacobianFactor(*keys, -seen.offset[i : i + 1], noise), values)


def offset_priors(walls: list[int], sigma_built: float) -> Iterator[gtsam.NonlinearFactor]:
    """The Laplace priors of the offsets of walls, with a standard deviation (m): a Huber loss with a short square."""
    sigma = float(np.sqrt(_SMOOTH * sigma_built / np.sqrt(2.0)))
    loss = gtsam.noiseModel.mEstimator.Huber.Create(_SMOOTH / sigma)
    noise = gtsam.noiseModel.Robust.Create(loss, gtsam.noiseModel.Isotropic.Sigma(1, sigma))
    for wall in walls:
        yield gtsam.PriorFactorVector(V(wall), np.zeros(1), noise)
