"""Extracts the floor under the robot from one roughly levelled scan."""

from dataclasses import dataclass

import numpy as np

from sgslam.perception.column_scan import Floats


@dataclass(frozen=True)
class FloorObservation:
    """The floor's `plane` (nx, ny, nz, d), n upwards, n.x + d = 0, so that d is the sensor's height (m).

    `sigma_normal` (rad) and `sigma_offset` (m) are those of the fit, `points` the number of inliers.
    """

    plane: Floats
    sigma_normal: float
    sigma_offset: float
    points: int


def extract_floor(points: Floats, expected: float | None, min_points: int = 60) -> FloorObservation | None:
    """The floor plane in points (N, 3) on level surfaces, z up to a few degrees; None where it is not seen.

    Takes the lowest strong peak of the heights' histogram and fits a plane to the points within 5 cm of it. A fit of
    all low points would include the feet of walls and furniture and be centimetres too high. `expected` (m) is the
    height of the floor in the same frame where it is already known.
    """
    z = points[:, 2]
    near = points[(z < -0.15) & (z > -2.5) if expected is None else np.abs(z - expected) < 0.15]
    if len(near) < min_points:
        return None
    height = _lowest_peak(near[:, 2], min_points)
    if height is None:
        return None
    solution = np.array([height, 0.0, 0.0])
    for tolerance in (0.08, 0.05, 0.05):
        residual = near[:, 2] - solution[0] - near[:, :2] @ solution[1:]
        inlier = np.abs(residual) < tolerance
        if inlier.sum() < min_points:
            return None
        design = np.column_stack([np.ones(inlier.sum()), near[inlier, :2]])
        information = design.T @ design / 0.02**2 + np.diag([0.0, 1 / 0.05**2, 1 / 0.05**2])
        solution = np.linalg.solve(information, design.T @ near[inlier, 2] / 0.02**2)
    covariance = np.linalg.inv(information)
    if np.hypot(*solution[1:]) > 0.15:
        return None
    normal = np.array([-solution[1], -solution[2], 1.0])
    scale = float(np.linalg.norm(normal))
    return FloorObservation(
        plane=np.array([*(normal / scale), -solution[0] / scale]),
        sigma_normal=float(np.sqrt(max(covariance[1, 1], covariance[2, 2]))),
        sigma_offset=float(np.sqrt(covariance[0, 0])),
        points=int(inlier.sum()),
    )


def _lowest_peak(z: Floats, min_points: int) -> float | None:
    count, edges = np.histogram(z, np.arange(z.min() - 0.06, z.max() + 0.06, 0.02))
    window = np.convolve(count, np.ones(3), "same")
    strong = np.flatnonzero(window > max(min_points / 2, 0.5 * window.max()))
    if not len(strong):
        return None
    first = strong[0]
    peak = first + int(np.argmax(window[first : first + 5]))
    return float(edges[peak] + 0.01)
