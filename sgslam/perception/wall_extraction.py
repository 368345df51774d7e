"""Extracts vertical wall planes with their extent from one levelled scan."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from data.common.compiled import compiled
from sgslam.config import SurfaceSettings
from sgslam.config.sensor import BUILDING, SENSOR
from sgslam.perception.column_scan import ColumnScan, Contour, Floats, contour, split_chains

_LEAST_COLUMNS = 5  # of the virtual scan in a wall piece
_MERGE_GAP = 0.5  # m between collinear pieces of one scan that are merged


@dataclass
class WallObservation:
    """One wall piece seen in one scan.

    `plane` is (nx, ny, nz, d) with n.x + d = 0 and n towards the sensor; `ends` (2, 3) its footprint, halfway up, or
    (2, 2) in plan view in the levelled frame (x y from the sensor, z above the floor); `heights` the lowest and highest
    inlier above the floor; the sigmas are the fit's, of the normal (the worse of its two angles) and of the offset at
    the foot of the perpendicular.
    """

    plane: Floats
    ends: Floats
    heights: tuple[float, float]
    sigma_normal: float
    sigma_offset: float


def extract_walls(scan: ColumnScan, high: Contour, settings: SurfaceSettings) -> list[WallObservation]:
    """Wall pieces in a scan with z above the floor: split and merge on the `high` band's contour, a fit on all heights.

    Where the low band stands 6 to 30 cm before the high one, the high one is a window in its niche and is
    dropped.
    """
    column, line = high
    if len(line) < _LEAST_COLUMNS:
        return []
    line, column = _from_farthest(line, column, scan.columns)
    parapet = np.full((scan.columns, 2), np.nan)
    low_column, low_line = contour(scan, settings.low_band)
    parapet[low_column] = low_line
    start = np.searchsorted(scan.column, np.arange(scan.columns + 1))
    found = []
    for first, last in _merge(split_chains(line, column, 2 * np.pi / scan.columns, settings.split), line, settings):
        if last - first + 1 < _LEAST_COLUMNS or np.hypot(*(line[last] - line[first])) < settings.min_length:
            continue
        if _is_window(line[first : last + 1], parapet[column[first : last + 1] % scan.columns]):
            continue
        # the outermost columns end the piece, but their points may be of the walls beside it
        own = _between(scan, start, int(column[first]) + 1, int(column[last]) - 1)
        own = own[(own[:, 2] > settings.low_band[0]) & (own[:, 2] < settings.high_band[1])]
        observation = fit_wall(own, line[first], line[last], settings)
        if observation is not None:
            found.append(observation)
    return found


def fit_wall(points: Floats, first: Floats, last: Floats, settings: SurfaceSettings) -> WallObservation | None:
    """Fits a plane to the points (N, 3) close to the vertical one through `first` and `last` (2,).

    Linear least squares of the distance across by the positions along and up, in two passes; None where it fails.
    """
    middle, (dx, dy) = (first + last) / 2, (last - first).tolist()
    length = math.hypot(dx, dy)
    tangent, normal = np.array([dx, dy]) / length, np.array([-dy, dx]) / length
    if normal @ first > 0:  # towards the sensor, which is the origin
        normal = -normal
    near = middle, tangent, normal, length / 2 + 0.1
    everything, _, _ = _moments(points, *near, 0.0, np.zeros(3), np.inf)
    count = everything[0, 0]
    level = everything[0, 2] / max(count, 1.0)
    solution, upright = np.zeros(3), np.diag([0.0, 0.0, 1 / BUILDING.plumb**2])  # the latter in 1/rad2
    for tolerance in (settings.split, 0.75 * settings.split):
        moments, low, high = _moments(points, *near, level, solution, tolerance)
        if moments[0, 0] < 2 * _LEAST_COLUMNS:
            return None
        covariance = np.linalg.inv(moments[:3, :3] / SENSOR.range_noise**2 + upright)
        solution = covariance @ moments[:3, 3] / SENSOR.range_noise**2
    seen = moments[0, 0]
    if abs(solution[2]) > BUILDING.steepest_wall or count > 5 * seen:
        return None
    residual = np.array([*-solution, 1.0])
    # the residual of the fit, where it is larger than the noise of ranges
    covariance *= max(residual @ moments @ residual / seen / SENSOR.range_noise**2, 0.25)
    above = moments[0, 2] / seen  # of the inliers' mean height over `level`
    at_mean = np.array([1.0, 0.0, above])
    offset, sigma = float(at_mean @ solution), float(at_mean @ covariance @ at_mean)
    plane_normal = np.array([*(normal - solution[1] * tangent), -solution[2]])
    scale = math.sqrt(plane_normal @ plane_normal)
    centre = np.array([*(middle + offset * normal), level + above])
    spread = np.array([[-length / 2], [length / 2]])
    foot = float(centre[:2] @ tangent)
    return WallObservation(
        plane=np.array([*(plane_normal / scale), -plane_normal @ centre / scale]),
        ends=middle + spread * tangent + (offset + solution[1] * spread) * normal,
        heights=(level + low, level + high),
        sigma_normal=math.sqrt(max(covariance[1, 1], covariance[2, 2])),
        sigma_offset=math.sqrt(sigma + foot**2 * covariance[1, 1]),
    )


@compiled
def _moments(
    points: Floats,
    middle: Floats,
    tangent: Floats,
    normal: Floats,
    half: float,
    level: float,
    solution: Floats,
    tolerance: float,
) -> tuple[Floats, float, float]:
    """(4, 4) the second moments of (1, along, up, across) of the points (N, 3) that are within `half` of the middle and
    within the tolerance of the plane across = solution . (1, along, up), up from `level`; the lowest and highest up."""
    moments, row, low, high = np.zeros((4, 4)), np.ones(4), np.inf, -np.inf
    for i in range(len(points)):
        x, y = points[i, 0] - middle[0], points[i, 1] - middle[1]
        row[1], row[2] = tangent[0] * x + tangent[1] * y, points[i, 2] - level
        row[3] = normal[0] * x + normal[1] * y
        off = row[3] - solution[0] - solution[1] * row[1] - solution[2] * row[2]
        if abs(row[1]) < half and abs(off) < tolerance:
            low, high = min(low, row[2]), max(high, row[2])
            for a in range(4):
                for b in range(4):
                    moments[a, b] += row[a] * row[b]
    return moments, low, high


def _from_farthest(contour: Floats, column: NDArray[np.int64], columns: int) -> tuple[Floats, NDArray[np.int64]]:
    """Rotates the closed contour to begin at its farthest point, the end of a straight piece; columns keep rising.

    So the seam of the scan cuts no wall.
    """
    first = int(np.argmax(np.hypot(contour[:, 0], contour[:, 1])))
    turned = np.concatenate([column[first:], column[:first] + columns])
    return np.roll(contour, -first, axis=0), turned


def _merge(pieces: list[tuple[int, int]], contour: Floats, settings: SurfaceSettings) -> list[tuple[int, int]]:
    """Joins neighbouring pieces that lie on one line with a gap of at most `merge_gap`."""
    merged: list[tuple[int, int]] = []
    for piece in pieces:
        while merged and _collinear(merged[-1], piece, contour, settings):
            piece = (merged.pop()[0], piece[1])
        merged.append(piece)
    return merged


def _collinear(a: tuple[int, int], b: tuple[int, int], contour: Floats, settings: SurfaceSettings) -> bool:
    points = contour[[a[0], b[1], a[1], b[0], (a[0] + a[1]) // 2, (b[0] + b[1]) // 2]]
    (x0, y0), (x1, y1), (ax, ay), (bx, by), *_ = inner = points.tolist()
    if math.hypot(bx - ax, by - ay) > _MERGE_GAP:
        return False
    dx, dy = x1 - x0, y1 - y0
    limit = settings.split * (math.hypot(dx, dy) + 1e-9)
    return all(abs((y - y0) * dx - (x - x0) * dy) < limit for x, y in inner[2:])


def _between(scan: ColumnScan, start: NDArray[np.int64], first: int, last: int) -> Floats:
    """(N, 3) the upright points of the columns first to last, which may wrap around the end of the scan."""
    if last >= scan.columns and first < scan.columns:
        parts = [slice(start[first], None), slice(0, start[last - scan.columns + 1])]
    else:
        parts = [slice(start[first % scan.columns], start[last % scan.columns + 1])]
    return np.concatenate([scan.points[part][scan.upright[part]] for part in parts])


@compiled
def _is_window(line: Floats, low: Floats) -> bool:
    """Whether the low band stands 6 to 30 cm before a piece, parallel to it, rather than on it.

    Anything further before it is furniture, which hides the parapet, and is ignored.
    """
    nx, ny = line[0, 1] - line[-1, 1], line[-1, 0] - line[0, 0]
    scale = math.hypot(nx, ny)
    if nx * line[0, 0] + ny * line[0, 1] > 0:
        scale = -scale
    on_it, in_niche, mean, squares = 0, 0, 0.0, 0.0
    for i in range(len(line)):
        before = ((low[i, 0] - line[i, 0]) * nx + (low[i, 1] - line[i, 1]) * ny) / scale  # NaN where there is none
        on_it += abs(before) <= 0.06
        if 0.06 < before < 0.30:
            in_niche += 1
            mean, squares = mean + before, squares + before**2
    if in_niche < 3 or in_niche <= 2 * on_it:
        return False
    mean, squares = mean / in_niche, squares / in_niche
    return squares - mean**2 < 0.04**2
