"""Extracts level surfaces (floors, ceilings, tops of furniture) from the surfels of a few scans of any sensor."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sgslam.config.sensor import BUILDING, SENSOR

Floats = NDArray[np.float64]
_LEVEL = float(np.cos(np.radians(6.0)))  # of a surfel's normal and the vertical; normals are known to 4 degrees
_MOST = 50.0  # points that a surfel counts for: those of one patch share errors
INLIER = 2.5 * SENSOR.range_noise  # m from the plane
CELL = 0.5  # m, of the grid in which the area is counted


@dataclass
class LevelObservation:
    """A level surface seen in a few scans, in the frame of a sensor pose.

    `plane` is (nx, ny, nz, d) with n.x + d = 0 and n towards the side that was seen; `places` (C, 3) are the middles of
    its points in each cell, of `CELL` m, in which it was seen. `is_floor`: it was seen from above, like a floor or a
    table, not a ceiling. The sigmas are the fit's, of the normal (rad) and of the offset at the frame's origin (m).
    """

    plane: Floats
    places: Floats
    is_floor: bool
    sigma_normal: float
    sigma_offset: float


def extract_levels(means: Floats, normals: Floats, counts: Floats, T_odom_sensor: Floats) -> list[LevelObservation]:
    """Level surfaces among surfels, larger first for each side.

    `means` (N, 3) and `normals` (N, 3), to the side seen, are in a frame with z up, `counts` (N,) their points. The
    observations are in the frame of the sensor at `T_odom_sensor` (4, 4).
    """
    relative, weights = means - T_odom_sensor[:3, 3], np.minimum(counts, _MOST)
    found = []
    for side in (1.0, -1.0):
        own = side * normals[:, 2] > _LEVEL
        for height, slopes, covariance, seen in _fits(relative[own], weights[own]):
            up = np.array([-slopes[0], -slopes[1], 1.0])
            scale = side / float(np.linalg.norm(up))
            normal = T_odom_sensor[:3, :3].T @ (up * scale)
            found.append(
                LevelObservation(
                    np.array([*normal, -height * scale]),
                    middles_of_cells(seen) @ T_odom_sensor[:3, :3],
                    side > 0,
                    float(np.sqrt(covariance[[1, 2], [1, 2]].max())),
                    float(np.sqrt(covariance[0, 0])),
                )
            )
    return found


def _fits(points: Floats, weights: Floats) -> list[tuple[float, Floats, Floats, Floats]]:
    """(height at the origin, slopes (2,), covariance (3, 3), points (M, 3)) of planes through points (N, 3), the one
    with the most points first."""
    found = []
    while _area(points) >= BUILDING.least_floor:
        solution, inlier = np.array([_peak(points[:, 2], weights), 0.0, 0.0]), np.zeros(len(points), bool)
        design = np.column_stack([np.ones(len(points)), points[:, :2]])
        covariance = np.eye(3)
        for _ in range(3):
            inlier = np.abs(points[:, 2] - design @ solution) < INLIER
            weighted = design[inlier].T * (weights[inlier] / SENSOR.range_noise**2)
            level = np.diag([1e-6, 1 / BUILDING.level**2, 1 / BUILDING.level**2])
            covariance = np.linalg.inv(weighted @ design[inlier] + level)
            solution = covariance @ weighted @ points[inlier, 2]
        across = points[inlier, 2] - design[inlier] @ solution
        # what is not level, or not one surface, is rougher than the noise
        rough = np.average(across**2, weights=weights[inlier]) > SENSOR.range_noise**2 if inlier.any() else True
        is_level = np.hypot(*solution[1:]) < BUILDING.steepest_floor
        if is_level and not rough and _area(points[inlier]) >= BUILDING.least_floor:
            found.append((float(solution[0]), solution[1:], covariance, points[inlier]))
        near = np.abs(points[:, 2] - design @ solution) < 2 * INLIER
        near |= inlier | (np.abs(points[:, 2] - _peak(points[:, 2], weights)) < SENSOR.range_noise)
        points, weights = points[~near], weights[~near]
    return found


def _peak(heights: Floats, weights: Floats) -> float:
    """The height (m) near which most points lie."""
    step = SENSOR.range_noise
    edges = np.arange(heights.min() - 2 * step, heights.max() + 3 * step, step)
    count, _ = np.histogram(heights, edges, weights=weights)
    return float(edges[int(np.argmax(np.convolve(count, np.ones(3), "same")))] + step / 2)


def _area(points: Floats) -> float:
    """m2 of the cells in plan view that hold points (N, 3)."""
    return len(np.unique(_cells(points))) * CELL**2


def middles_of_cells(points: Floats) -> Floats:
    """(C, 3) the mean of the points (N, 3) in each cell in plan view that holds some."""
    _, own, count = np.unique(_cells(points), return_inverse=True, return_counts=True)
    sums = [np.bincount(own.ravel(), points[:, k]) for k in range(3)]
    return np.column_stack(sums) / count[:, None]


def _cells(points: Floats) -> NDArray[np.int64]:
    """(N,) a number of the cell in plan view of each point (N, 3)."""
    cells = np.floor(points[:, :2] / CELL).astype(np.int64)
    return np.asarray(cells[:, 0] * 1_000_003 + cells[:, 1])
